// SPDX-License-Identifier: Apache-2.0
// Meshes that were cut along edges, and by definition what joining them does (docs/design.md,
// "Welding"): the oracle of SeamJoin.
#pragma once

#include <algorithm>
#include <map>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

struct JoinedSeams {
  std::vector<VertexIndex> first;  // that each vertex becomes
  std::vector<VertexIndex> like;   // the first of equal position and row
  std::vector<bool> has_area;      // triangles whose corners are not alike
  uint64_t gone = 0;               // vertices
};

// The triangle has a normal that says something.
inline bool UnitNormal(const TriangleMesh& mesh, const TriangleVertices& t, Vec3d* normal) {
  const Vec3d a = mesh.positions[t[0]], b = mesh.positions[t[1]], c = mesh.positions[t[2]];
  *normal = Cross(b - a, c - a);
  const double length = Length(*normal);
  const double longest = std::max({Length(b - a), Length(c - a), Length(c - b)});
  if (!(length > 1e-3 * longest * longest)) return false;
  *normal = *normal * (1 / length);
  return true;
}

inline JoinedSeams JoinSeamsByDefinition(const TriangleMesh& mesh) {
  JoinedSeams joined;
  const size_t row = mesh.header.attributes.row_bytes();
  std::map<std::pair<Vec3d, Bytes>, VertexIndex> likes;
  for (VertexIndex v = 0; v < mesh.positions.size(); ++v) {
    const auto from = mesh.rows.begin() + static_cast<std::ptrdiff_t>(v * row);
    const Bytes own(from, from + static_cast<std::ptrdiff_t>(row));
    joined.like.push_back(
        likes.emplace(std::pair(mesh.positions[v] + Vec3d{}, own), v).first->second);
  }
  // Of each edge from one like to another, the corners where it begins.
  using Corner = std::pair<size_t, size_t>;
  std::map<std::pair<VertexIndex, VertexIndex>, std::vector<Corner>> edges;
  const auto like = [&](const Corner& c, size_t on) {
    return joined.like[mesh.triangles[c.first][(c.second + on) % 3]];
  };
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    const VertexIndex a = like({t, 0}, 0), b = like({t, 1}, 0), c = like({t, 2}, 0);
    joined.has_area.push_back(a != b && b != c && c != a);
    for (size_t i = 0; joined.has_area[t] && i < 3; ++i) {
      edges[{like({t, i}, 0), like({t, i}, 1)}].emplace_back(t, i);
    }
  }
  joined.first.resize(mesh.positions.size());
  std::iota(joined.first.begin(), joined.first.end(), VertexIndex{0});
  const auto find = [&](VertexIndex v) {
    while (joined.first[v] != v) v = joined.first[v];
    return v;
  };
  for (const auto& [ends, there] : edges) {
    const auto back = edges.find({ends.second, ends.first});
    if (there.size() != 1 || back == edges.end() || back->second.size() != 1) continue;
    const Corner a = there[0], b = back->second[0];
    Vec3d one, other;
    const bool fold = UnitNormal(mesh, mesh.triangles[a.first], &one) &&
                      UnitNormal(mesh, mesh.triangles[b.first], &other) &&
                      Dot(one, other) < -0.9999;
    if (fold || like(a, 2) == like(b, 2)) continue;
    for (size_t i = 0; i < 2; ++i) {
      const VertexIndex v = find(mesh.triangles[a.first][(a.second + i) % 3]);
      const VertexIndex w = find(mesh.triangles[b.first][(b.second + 1 - i) % 3]);
      joined.first[std::max(v, w)] = std::min(v, w);
    }
  }
  for (VertexIndex v = 0; v < joined.first.size(); ++v) {
    joined.first[v] = find(v);
    joined.gone += joined.first[v] != v;
  }
  return joined;
}

// The mesh, in which a part of the corners have vertices of their own.
inline TriangleMesh CutMesh(const TriangleMesh& mesh, double part, uint64_t seed) {
  TriangleMesh cut = mesh;
  cut.header.vertex_count.reset();
  const size_t row = mesh.header.attributes.row_bytes();
  std::mt19937_64 random(seed);
  for (TriangleVertices& t : cut.triangles) {
    for (VertexIndex& v : t) {
      if (static_cast<double>(random() % 1'000'000) >= part * 1'000'000) continue;
      cut.positions.push_back(cut.positions[v]);
      const Bytes own(cut.rows.begin() + static_cast<std::ptrdiff_t>(v * row),
                      cut.rows.begin() + static_cast<std::ptrdiff_t>((v + 1) * row));
      cut.rows.insert(cut.rows.end(), own.begin(), own.end());
      v = cut.positions.size() - 1;
    }
  }
  return cut;
}

}  // namespace mtdb::testing
