// CheckMesh: counts what is right and wrong with an indexed triangle mesh, by plain counting. For
// tests; independent of mtdb's own code.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

struct MeshCheck {
  uint64_t vertices = 0;
  uint64_t triangles = 0;
  uint64_t edges = 0;  // undirected
  uint64_t boundary_edges = 0;
  uint64_t boundary_loops = 0;
  uint64_t components = 0;  // of vertices joined by edges
  int64_t euler_characteristic = 0;
  // Wrong in a manifold, oriented mesh.
  uint64_t bad_indices = 0;
  uint64_t unused_vertices = 0;
  uint64_t degenerate_triangles = 0;
  uint64_t duplicate_triangles = 0;   // the same three vertices
  uint64_t nonmanifold_edges = 0;     // more than two triangles
  uint64_t misoriented_edges = 0;     // two triangles that run along it in the same direction
  uint64_t nonmanifold_vertices = 0;  // triangles around it are not one fan

  // Conforming, oriented and manifold (with or without border).
  bool ok() const {
    return bad_indices + unused_vertices + degenerate_triangles + duplicate_triangles +
               nonmanifold_edges + misoriented_edges + nonmanifold_vertices ==
           0;
  }
};

inline MeshCheck CheckMesh(const TriangleMesh& mesh) {
  MeshCheck check;
  const size_t n = mesh.positions.size();
  check.vertices = n;
  check.triangles = mesh.triangles.size();
  std::vector<size_t> group(n);
  std::iota(group.begin(), group.end(), size_t{0});
  const auto find = [&](size_t v) {
    while (group[v] != v) v = group[v] = group[group[v]];
    return v;
  };
  using Edge = std::pair<uint64_t, uint64_t>;
  std::map<Edge, int> directed;
  std::set<std::array<uint64_t, 3>> seen;
  std::vector<std::map<uint64_t, uint64_t>> links(n);  // per vertex: ring edges a -> b
  std::vector<uint64_t> corners(n, 0);
  for (const TriangleVertices& t : mesh.triangles) {
    if (t[0] >= n || t[1] >= n || t[2] >= n) {
      ++check.bad_indices;
      continue;
    }
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) ++check.degenerate_triangles;
    std::array<uint64_t, 3> key{t[0], t[1], t[2]};
    std::sort(key.begin(), key.end());
    if (!seen.insert(key).second) ++check.duplicate_triangles;
    for (size_t c = 0; c < 3; ++c) {
      const uint64_t a = t[c];
      const uint64_t b = t[(c + 1) % 3];
      ++directed[{a, b}];
      group[find(a)] = find(b);
      links[a][b] = t[(c + 2) % 3];
      ++corners[a];
    }
  }
  std::map<uint64_t, std::vector<uint64_t>> border;  // directed border edges a -> b
  for (const auto& [edge, count] : directed) {
    const auto opposite = directed.find({edge.second, edge.first});
    const int other = opposite == directed.end() ? 0 : opposite->second;
    if (edge.first < edge.second || other == 0) {
      ++check.edges;
      if (count + other > 2) {
        ++check.nonmanifold_edges;
      } else if (count != other && count + other == 2) {
        ++check.misoriented_edges;
      }
    }
    if (count == 1 && other == 0) {
      ++check.boundary_edges;
      border[edge.first].push_back(edge.second);
    }
  }
  for (size_t v = 0; v < n; ++v) {
    if (corners[v] == 0) {
      ++check.unused_vertices;
      continue;
    }
    if (find(v) == v) ++check.components;
    // One fan: starting where no edge arrives (or anywhere), all corners are passed.
    std::set<uint64_t> arrivals;
    for (const auto& [a, b] : links[v]) arrivals.insert(b);
    uint64_t start = links[v].begin()->first;
    for (const auto& [a, b] : links[v]) {
      if (!arrivals.contains(a)) start = a;
    }
    uint64_t passed = 0;
    uint64_t at = start;
    while (links[v].contains(at) && passed <= corners[v]) {
      at = links[v].at(at);
      ++passed;
      if (at == start) break;
    }
    if (passed != corners[v]) ++check.nonmanifold_vertices;
  }
  while (!border.empty()) {
    uint64_t at = border.begin()->first;
    while (border.contains(at)) {
      std::vector<uint64_t>& next = border.at(at);
      const uint64_t to = next.back();
      next.pop_back();
      if (next.empty()) border.erase(at);
      at = to;
    }
    ++check.boundary_loops;
  }
  check.euler_characteristic = static_cast<int64_t>(n - check.unused_vertices) -
                               static_cast<int64_t>(check.edges) +
                               static_cast<int64_t>(check.triangles);
  return check;
}

}  // namespace mtdb::testing
