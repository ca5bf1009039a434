// SPDX-License-Identifier: Apache-2.0
// Meshes whose distances are known, or as awkward as can be.
#pragma once

#include <random>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

// A triangulated sphere of 2 * side * side or so triangles.
TriangleMesh Sphere(int side, double radius);
// The unit square at height 0, of 2 * side * side triangles, with dents of that depth and of the
// radius 0.05.
TriangleMesh Plane(int side, const std::vector<Vec3d>& dents, double depth);
TriangleMesh Moved(TriangleMesh mesh, Vec3d by);
// Each vertex moved at random by up to `by` along each axis.
TriangleMesh Shaken(TriangleMesh mesh, double by);
// Without the triangles beyond x.
TriangleMesh Clipped(TriangleMesh mesh, double x);
// Single triangles of all shapes, needles among them.
TriangleMesh Soup(int triangles, std::mt19937& random);

}  // namespace mtdb::testing
