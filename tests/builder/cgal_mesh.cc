// SPDX-License-Identifier: Apache-2.0
#include "tests/builder/cgal_mesh.h"

#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/helpers.h>
#include <iterator>
#include <vector>

namespace mtdb::testing {

CgalFacts AskCgal(const TriangleMesh& mesh) {
  namespace Pmp = CGAL::Polygon_mesh_processing;
  using Point = CGAL::Simple_cartesian<double>::Point_3;
  using SurfaceMesh = CGAL::Surface_mesh<Point>;

  CgalFacts facts;
  std::vector<Point> points;
  points.reserve(mesh.positions.size());
  for (const Vec3d& p : mesh.positions) points.emplace_back(p.x, p.y, p.z);
  std::vector<std::array<size_t, 3>> polygons;
  polygons.reserve(mesh.triangles.size());
  for (const TriangleVertices& t : mesh.triangles) polygons.push_back({t[0], t[1], t[2]});
  facts.manifold = Pmp::is_polygon_soup_a_polygon_mesh(polygons);
  if (!facts.manifold) return facts;

  SurfaceMesh surface;
  Pmp::polygon_soup_to_polygon_mesh(points, polygons, surface);
  facts.manifold = CGAL::is_triangle_mesh(surface) && CGAL::is_valid_polygon_mesh(surface) &&
                   num_faces(surface) == mesh.triangles.size();
  facts.closed = CGAL::is_closed(surface);
  facts.euler_characteristic = static_cast<int64_t>(num_vertices(surface)) -
                               static_cast<int64_t>(num_edges(surface)) +
                               static_cast<int64_t>(num_faces(surface));
  std::vector<SurfaceMesh::Halfedge_index> cycles;
  Pmp::extract_boundary_cycles(surface, std::back_inserter(cycles));
  facts.border_loops = cycles.size();
  for (const auto h : halfedges(surface)) facts.border_edges += CGAL::is_border(h, surface);
  auto component = surface.add_property_map<SurfaceMesh::Face_index, size_t>("component").first;
  facts.components = Pmp::connected_components(surface, component);
  return facts;
}

}  // namespace mtdb::testing
