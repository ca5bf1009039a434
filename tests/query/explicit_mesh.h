// SPDX-License-Identifier: Apache-2.0
// ExplicitMesh: what a client of a session holds, kept the plain way.
#pragma once

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "codecs/stream/mesh_update.h"
#include "tests/query/mt_fixture.h"

namespace mtdb::testing {

// Checks every rule of UpdateBatch while it follows the updates.
class ExplicitMesh {
 public:
  explicit ExplicitMesh(const BaseMesh& base) {
    for (size_t v = 0; v < base.vertices.size(); ++v) {
      positions_[base.vertices[v]] = base.positions[v];
    }
    for (size_t t = 0; t < base.triangles.size(); ++t) {
      const auto& c = base.triangles[t];
      triangles_[base.triangle_keys[t]] = {base.vertices[c[0]], base.vertices[c[1]],
                                           base.vertices[c[2]]};
    }
  }
  void Apply(const UpdateBatch& batch) {
    std::set<TriangleKey> before;
    for (const auto& [key, t] : triangles_) before.insert(key);
    for (size_t n = 0; n < batch.nodes.size(); ++n) {
      const UpdateBatch::Node& node = batch.nodes[n];
      const auto ring = batch.ring_of(node);
      std::vector<std::pair<TriangleKey, TriangleVertices>> hole, star;
      for (const auto& t : batch.hole_of(node)) {
        hole.push_back({t.key, {ring[t.corners[0]], ring[t.corners[1]], ring[t.corners[2]]}});
      }
      for (uint32_t j = 0; j < UpdateBatch::StarCount(node); ++j) {
        star.push_back({node.first_star + j, {node.vertex, ring[j], ring[(j + 1) % ring.size()]}});
      }
      for (const auto& [key, t] : batch.insert ? hole : star) {
        REQUIRE(before.count(key) == 1);  // nothing that this batch made
        REQUIRE(Rotated(triangles_.at(key)) == Rotated(t));
        triangles_.erase(key);
      }
      for (const auto& [key, t] : batch.insert ? star : hole) {
        REQUIRE(triangles_.emplace(key, t).second);
      }
      if (batch.insert) {
        REQUIRE(positions_.emplace(node.vertex, node.position).second == !node.twin);
      } else if (batch.EndOfUpdate(n) == n + 1) {
        REQUIRE(positions_.erase(node.vertex) == 1);
      }
    }
    for (const UpdateBatch::Crumb& crumb : batch.crumbs) Apply(batch.insert, crumb, before);
  }
  std::multiset<std::array<Vec3i, 3>> Positions() const {
    std::multiset<std::array<Vec3i, 3>> set;
    ForEach([&](TriangleKey, const std::array<Vec3i, 3>& t) { set.insert(t); });
    return set;
  }
  // Calls f(key, positions) for each triangle, the smallest position first.
  template <typename F>
  void ForEach(F&& f) const {
    for (const auto& [key, t] : triangles_) {
      f(key, Smallest(std::array<Vec3i, 3>{positions_.at(t[0]), positions_.at(t[1]),
                                           positions_.at(t[2])}));
    }
  }
  // The vertices of each triangle, in the order of the updates, and where these lie.
  const std::map<TriangleKey, TriangleVertices>& triangles() const { return triangles_; }
  Vec3i position(VertexIndex vertex) const { return positions_.at(vertex); }
  template <typename T>
  static std::array<T, 3> Smallest(const std::array<T, 3>& t) {
    return std::min({t, std::array<T, 3>{t[1], t[2], t[0]}, std::array<T, 3>{t[2], t[0], t[1]}});
  }

 private:
  void Apply(bool insert, const UpdateBatch::Crumb& crumb, const std::set<TriangleKey>& before) {
    REQUIRE(!crumb.renamed.empty());
    for (const UpdateBatch::Crumb::Renamed& renamed : crumb.renamed) {
      const TriangleKey from = insert ? renamed.without : renamed.with;
      REQUIRE(before.count(from) == 1);
      const TriangleVertices t = triangles_.at(from);
      triangles_.erase(from);
      REQUIRE(triangles_.emplace(insert ? renamed.with : renamed.without, t).second);
    }
    for (size_t v = 0; insert && v < crumb.vertices.size(); ++v) {
      REQUIRE(positions_.emplace(crumb.vertices[v], crumb.positions[v]).second);
    }
    for (size_t t = 0; t < crumb.triangles.size(); ++t) {
      if (insert) {
        for (const VertexIndex v : crumb.triangles[t]) REQUIRE(positions_.contains(v));
        REQUIRE(triangles_.emplace(crumb.keys[t], crumb.triangles[t]).second);
      } else {
        REQUIRE(before.count(crumb.keys[t]) == 1);
        REQUIRE(Rotated(triangles_.at(crumb.keys[t])) == Rotated(crumb.triangles[t]));
        triangles_.erase(crumb.keys[t]);
      }
    }
    for (const VertexIndex v : crumb.vertices) {
      if (!insert) REQUIRE(positions_.erase(v) == 1);
    }
  }
  static TriangleVertices Rotated(const TriangleVertices& t) { return Smallest(t); }
  std::map<VertexIndex, Vec3i> positions_;
  std::map<TriangleKey, TriangleVertices> triangles_;
};

inline std::multiset<std::array<Vec3i, 3>> CutPositions(const MtFixture& f,
                                                        const std::vector<bool>& applied) {
  std::multiset<std::array<Vec3i, 3>> set;
  for (const uint32_t id : f.mt.Mesh(applied)) {
    const auto& v = f.mt.triangles[id].vertices;
    set.insert(ExplicitMesh::Smallest(
        std::array<Vec3i, 3>{f.mt.positions[v[0]], f.mt.positions[v[1]], f.mt.positions[v[2]]}));
  }
  return set;
}

}  // namespace mtdb::testing
