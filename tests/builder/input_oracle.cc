// SPDX-License-Identifier: Apache-2.0
#include "tests/builder/input_oracle.h"

#include <algorithm>

namespace mtdb::testing {

InputOracle::InputOracle(const std::vector<TriangleVertices>& input, uint64_t vertex_count) {
  report.vertices = vertex_count;
  report.triangles = input.size();
  std::set<TriangleVertices> seen;
  for (TriangleVertices t : input) {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) {
      ++report.degenerate_triangles;
      continue;
    }
    while (t[0] > t[1] || t[0] > t[2]) t = {t[1], t[2], t[0]};
    if (!seen.insert(t).second) {
      ++report.duplicate_triangles;
      continue;
    }
    for (size_t c = 0; c < 3; ++c) {
      const VertexIndex a = t[c];
      const VertexIndex b = t[(c + 1) % 3];
      uses[Between(a, b)].push_back(a < b ? 1 : -1);
      at[a].push_back(kept.size());
    }
    kept.push_back(t);
  }
  report.unreferenced_vertices = vertex_count - at.size();
  for (const auto& [edge, u] : uses) {
    if (IsManifold(edge)) continue;
    ++report.nonmanifold_edges;
    fixed.insert(edge.first);
    fixed.insert(edge.second);
  }
  for (const auto& [v, triangles] : at) {
    if (Fans(v) > 1) fixed.insert(v);
  }
  report.nonmanifold_vertices = fixed.size();
}

bool InputOracle::IsManifold(const Edge& edge) const {
  const std::vector<int>& u = uses.at(edge);
  return u.size() == 1 || (u.size() == 2 && u[0] != u[1]);
}

uint64_t InputOracle::BorderEdges() const {
  uint64_t count = 0;
  for (const auto& [edge, u] : uses) count += u.size() == 1;
  return count;
}

// Groups of triangles at v that are joined by manifold edges at v.
size_t InputOracle::Fans(VertexIndex v) const {
  const std::vector<size_t>& triangles = at.at(v);
  std::map<VertexIndex, std::vector<size_t>> by_edge;
  for (size_t i = 0; i < triangles.size(); ++i) {
    for (const VertexIndex w : kept[triangles[i]]) {
      if (w != v && IsManifold(Between(v, w))) by_edge[w].push_back(i);
    }
  }
  std::vector<size_t> group(triangles.size());
  for (size_t i = 0; i < group.size(); ++i) group[i] = i;
  for (bool changed = true; changed;) {
    changed = false;
    for (const auto& [w, members] : by_edge) {
      const size_t least = std::min(group[members.front()], group[members.back()]);
      for (const size_t i : {members.front(), members.back()}) {
        changed |= group[i] != least;
        group[i] = least;
      }
    }
  }
  return std::set<size_t>(group.begin(), group.end()).size();
}

std::vector<TileTriangle> ClassifiedTriangles(const TriangleMesh& mesh, const Grid& grid) {
  const InputOracle oracle(mesh.triangles, mesh.positions.size());
  std::vector<TileTriangle> triangles;
  for (const TriangleVertices& kept : oracle.kept) {
    TileTriangle& t = triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      const bool border = oracle.IsBorder(InputOracle::Between(kept[c], kept[(c + 1) % 3]));
      t.vertices[c] = static_cast<uint32_t>(kept[c]);
      t.positions[c] = grid.Quantize(mesh.positions[kept[c]]);
      t.border_edges |= static_cast<uint8_t>(border << c);
      t.fixed_corners |= static_cast<uint8_t>(oracle.fixed.contains(kept[c]) << c);
    }
  }
  return triangles;
}

}  // namespace mtdb::testing
