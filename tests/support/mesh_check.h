// SPDX-License-Identifier: Apache-2.0
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
  uint64_t components = 0;           // of vertices joined by edges
  int64_t euler_characteristic = 0;  // triangles of the same vertices count once
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

// The walk that CheckMesh makes over a mesh.
class MeshChecker {
 public:
  explicit MeshChecker(const TriangleMesh& mesh)
      : mesh_(mesh), group_(mesh.positions.size()), links_(group_.size()), corners_(group_.size()) {
    std::iota(group_.begin(), group_.end(), size_t{0});
  }
  MeshCheck Check() {
    check_.vertices = mesh_.positions.size();
    check_.triangles = mesh_.triangles.size();
    for (const TriangleVertices& t : mesh_.triangles) AddTriangle(t);
    CountEdges();
    for (size_t v = 0; v < group_.size(); ++v) CountVertex(v);
    CountLoops();
    check_.euler_characteristic = static_cast<int64_t>(check_.vertices - check_.unused_vertices) -
                                  static_cast<int64_t>(check_.edges) +
                                  static_cast<int64_t>(seen_.size());
    return check_;
  }

 private:
  size_t Find(size_t v) {
    while (group_[v] != v) v = group_[v] = group_[group_[v]];
    return v;
  }
  void AddTriangle(const TriangleVertices& t) {
    const size_t n = group_.size();
    if (t[0] >= n || t[1] >= n || t[2] >= n) {
      ++check_.bad_indices;
      return;
    }
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) ++check_.degenerate_triangles;
    std::array<uint64_t, 3> key{t[0], t[1], t[2]};
    std::sort(key.begin(), key.end());
    if (!seen_.insert(key).second) ++check_.duplicate_triangles;
    for (size_t c = 0; c < 3; ++c) {
      const uint64_t a = t[c];
      const uint64_t b = t[(c + 1) % 3];
      ++directed_[{a, b}];
      group_[Find(a)] = Find(b);
      links_[a][b] = t[(c + 2) % 3];
      ++corners_[a];
    }
  }
  void CountEdges() {
    for (const auto& [edge, count] : directed_) {
      const auto opposite = directed_.find({edge.second, edge.first});
      const int other = opposite == directed_.end() ? 0 : opposite->second;
      if (edge.first < edge.second || other == 0) {
        ++check_.edges;
        if (count + other > 2) {
          ++check_.nonmanifold_edges;
        } else if (count != other && count + other == 2) {
          ++check_.misoriented_edges;
        }
      }
      if (count == 1 && other == 0) {
        ++check_.boundary_edges;
        border_[edge.first].push_back(edge.second);
      }
    }
  }
  void CountVertex(size_t v) {
    if (corners_[v] == 0) {
      ++check_.unused_vertices;
      return;
    }
    if (Find(v) == v) ++check_.components;
    // One fan: starting where no edge arrives (or anywhere), all corners are passed.
    std::set<uint64_t> arrivals;
    for (const auto& [a, b] : links_[v]) arrivals.insert(b);
    uint64_t start = links_[v].begin()->first;
    for (const auto& [a, b] : links_[v]) {
      if (!arrivals.contains(a)) start = a;
    }
    uint64_t passed = 0;
    uint64_t at = start;
    while (links_[v].contains(at) && passed <= corners_[v]) {
      at = links_[v].at(at);
      ++passed;
      if (at == start) break;
    }
    if (passed != corners_[v]) ++check_.nonmanifold_vertices;
  }
  void CountLoops() {
    while (!border_.empty()) {
      uint64_t at = border_.begin()->first;
      while (border_.contains(at)) {
        std::vector<uint64_t>& next = border_.at(at);
        const uint64_t to = next.back();
        next.pop_back();
        if (next.empty()) border_.erase(at);
        at = to;
      }
      ++check_.boundary_loops;
    }
  }

  const TriangleMesh& mesh_;
  MeshCheck check_;
  std::vector<size_t> group_;  // union-find of vertices that edges join
  std::map<std::pair<uint64_t, uint64_t>, int> directed_;
  std::set<std::array<uint64_t, 3>> seen_;
  std::vector<std::map<uint64_t, uint64_t>> links_;  // per vertex: ring edges a -> b
  std::vector<uint64_t> corners_;
  std::map<uint64_t, std::vector<uint64_t>> border_;  // directed border edges a -> b
};

inline MeshCheck CheckMesh(const TriangleMesh& mesh) { return MeshChecker(mesh).Check(); }

}  // namespace mtdb::testing
