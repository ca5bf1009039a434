// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/cgal_simplify.h"

#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Bounded_normal_change_placement.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/GarlandHeckbert_plane_policies.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_cost.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_placement.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>
#include <vector>

namespace mtdb {

namespace {

namespace Pmp = CGAL::Polygon_mesh_processing;
namespace Sms = CGAL::Surface_mesh_simplification;
using Kernel = CGAL::Simple_cartesian<double>;
using SurfaceMesh = CGAL::Surface_mesh<Kernel::Point_3>;

// Stops at a number of faces; CGAL's own predicates count edges.
struct FaceCountStop {
  size_t faces;
  template <typename Cost, typename Profile>
  bool operator()(const Cost&, const Profile& profile, size_t, size_t) const {
    return profile.surface_mesh().number_of_faces() <= faces;  // without removed ones
  }
};

}  // namespace

std::optional<TriangleMesh> SimplifyByCgal(const TriangleMesh& mesh, uint64_t triangles,
                                           CgalMethod method) {
  std::vector<Kernel::Point_3> points;
  for (const Vec3d& p : mesh.positions) points.emplace_back(p.x, p.y, p.z);
  std::vector<std::array<size_t, 3>> polygons;
  for (const TriangleVertices& t : mesh.triangles) polygons.push_back({t[0], t[1], t[2]});
  if (!Pmp::is_polygon_soup_a_polygon_mesh(polygons)) return std::nullopt;
  SurfaceMesh surface;
  Pmp::polygon_soup_to_polygon_mesh(points, polygons, surface);

  const FaceCountStop stop{triangles};
  if (method == CgalMethod::kGarlandHeckbert) {
    // As in CGAL's own example.
    using Policies = Sms::GarlandHeckbert_plane_policies<SurfaceMesh, Kernel>;
    const Policies policies(surface);
    const Sms::Bounded_normal_change_placement<Policies::Get_placement> placement(
        policies.get_placement());
    Sms::edge_collapse(surface, stop,
                       CGAL::parameters::get_cost(policies.get_cost()).get_placement(placement));
  } else {
    Sms::edge_collapse(surface, stop,
                       CGAL::parameters::get_cost(Sms::LindstromTurk_cost<SurfaceMesh>())
                           .get_placement(Sms::LindstromTurk_placement<SurfaceMesh>()));
  }
  surface.collect_garbage();
  TriangleMesh result;
  for (const auto v : vertices(surface)) {
    const Kernel::Point_3& p = surface.point(v);
    result.positions.push_back({p.x(), p.y(), p.z()});
  }
  for (const auto f : faces(surface)) {
    TriangleVertices& t = result.triangles.emplace_back();
    size_t c = 0;
    for (const auto v : vertices_around_face(halfedge(f, surface), surface)) t[c++] = v;
  }
  return result;
}

}  // namespace mtdb
