// SPDX-License-Identifier: Apache-2.0
// CGAL's triangulations in the plane, whose vertices carry a number: the oracle of Delaunay rules.
#pragma once

#include <CGAL/Constrained_Delaunay_triangulation_2.h>
#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>
#include <cstdint>

namespace mtdb::testing {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point2 = Kernel::Point_2;
using CgalVertex = CGAL::Triangulation_vertex_base_with_info_2<uint32_t, Kernel>;
using CgalDelaunay =
    CGAL::Delaunay_triangulation_2<Kernel, CGAL::Triangulation_data_structure_2<CgalVertex>>;
using CgalConstrained = CGAL::Constrained_Delaunay_triangulation_2<
    Kernel, CGAL::Triangulation_data_structure_2<
                CgalVertex, CGAL::Constrained_triangulation_face_base_2<Kernel>>>;

}  // namespace mtdb::testing
