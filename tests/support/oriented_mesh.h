// SPDX-License-Identifier: Apache-2.0
// By definition what --orient does to a mesh (docs/guide.md): the oracle of OrientSheets.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

struct OrientedMesh {
  std::vector<bool> turned;  // of each triangle
  uint64_t turned_triangles = 0;
  uint64_t inconsistent_edges = 0;  // before
  uint64_t unorientable_sheets = 0;
};

namespace orienting {

// The vertices of a triangle in ascending order, and whether they are so an even number of
// exchanges away.
struct Face {
  TriangleVertices vertices;
  bool even = true;
};
inline Face FaceOf(TriangleVertices t) {
  Face face{t, true};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j + 1 < 3; ++j) {
      if (face.vertices[j] <= face.vertices[j + 1]) continue;
      std::swap(face.vertices[j], face.vertices[j + 1]);
      face.even = !face.even;
    }
  }
  return face;
}

struct Copies {
  std::array<std::vector<size_t>, 2> triangles;  // of odd and of even ones
  bool two_sided() const { return !triangles[0].empty() && !triangles[1].empty(); }
};
using Faces = std::map<TriangleVertices, Copies>;

// Whether two even faces run through the edge in the same direction.
inline bool RunAlike(const TriangleVertices& a, const TriangleVertices& b, VertexIndex low,
                     VertexIndex high) {
  const auto forward = [&](const TriangleVertices& t) {
    return (t[0] == low && t[1] == high) || (t[1] == low && t[2] == high);
  };
  return forward(a) == forward(b);
}

}  // namespace orienting

// Triangles with two equal vertices stay.
inline OrientedMesh OrientByDefinition(const std::vector<TriangleVertices>& triangles) {
  using namespace orienting;
  OrientedMesh result;
  result.turned.assign(triangles.size(), false);
  Faces faces;
  for (size_t i = 0; i < triangles.size(); ++i) {
    const Face face = FaceOf(triangles[i]);
    const TriangleVertices& v = face.vertices;
    if (v[0] != v[1] && v[1] != v[2]) faces[v].triangles[face.even].push_back(i);
  }
  std::map<std::pair<VertexIndex, VertexIndex>, std::vector<TriangleVertices>> at;
  for (const auto& [v, copies] : faces) {
    for (const auto& [a, b] : {std::pair(v[0], v[1]), {v[1], v[2]}, {v[0], v[2]}}) {
      at[{a, b}].push_back(v);
    }
  }
  // Neighbours, and whether one of two is to be odd when the other one is even.
  std::map<TriangleVertices, std::vector<std::pair<TriangleVertices, bool>>> neighbours;
  const auto is_even = [&](const TriangleVertices& v) { return !faces[v].triangles[1].empty(); };
  for (const auto& [edge, both] : at) {
    if (both.size() != 2 || faces[both[0]].two_sided() || faces[both[1]].two_sided()) continue;
    const bool differ = RunAlike(both[0], both[1], edge.first, edge.second);
    result.inconsistent_edges += differ != (is_even(both[0]) != is_even(both[1]));
    neighbours[both[0]].emplace_back(both[1], differ);
    neighbours[both[1]].emplace_back(both[0], differ);
  }
  std::map<TriangleVertices, bool> even;  // once it is decided
  for (const auto& [seed, seed_copies] : faces) {
    if (seed_copies.two_sided() || even.contains(seed)) continue;
    std::vector<TriangleVertices> sheet{seed};
    even[seed] = true;
    bool orientable = true;
    for (size_t i = 0; i < sheet.size(); ++i) {
      for (const auto& [next, differ] : neighbours[sheet[i]]) {
        const bool wanted = even[sheet[i]] != differ;
        const auto [place, added] = even.emplace(next, wanted);
        if (added) sheet.push_back(next);
        orientable &= place->second == wanted;
      }
    }
    if (!orientable) {
      ++result.unorientable_sheets;
      continue;
    }
    // Those that agree with what was decided, and those that do not.
    std::array<std::vector<size_t>, 2> sides;
    for (const TriangleVertices& v : sheet) {
      for (const size_t parity : {0, 1}) {
        for (const size_t t : faces[v].triangles[parity]) {
          sides[(parity == 1) == even[v]].push_back(t);
        }
      }
    }
    const auto first = [](const std::vector<size_t>& side) {
      return *std::min_element(side.begin(), side.end());
    };
    size_t less = sides[0].size() < sides[1].size() ? 0 : 1;
    if (sides[0].size() == sides[1].size()) less = first(sides[0]) < first(sides[1]) ? 1 : 0;
    for (const size_t t : sides[less]) result.turned[t] = true;
    result.turned_triangles += sides[less].size();
  }
  return result;
}

// Turns those over.
inline void TurnOver(const OrientedMesh& oriented, std::vector<TriangleVertices>* triangles) {
  for (size_t i = 0; i < triangles->size(); ++i) {
    if (oriented.turned[i]) std::swap((*triangles)[i][1], (*triangles)[i][2]);
  }
}

}  // namespace mtdb::testing
