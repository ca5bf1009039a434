// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "codecs/cluster/cluster.h"

namespace mtdb {
namespace {

std::array<Vec3i, 3> Rotated(const std::array<Vec3i, 3>& p, size_t r) {
  return {p[r], p[(r + 1) % 3], p[(r + 2) % 3]};
}

TEST_CASE("the canonical order is that of the least rotations, whatever the numbers") {
  std::mt19937 random(7);
  // Small ranges make ties; the last one is all of int32.
  for (const uint64_t range : {uint64_t{2}, uint64_t{5}, uint64_t{3000}, uint64_t{1} << 32}) {
    const auto coordinate = [&] {
      return static_cast<int32_t>(static_cast<uint32_t>(random() % range) -
                                  static_cast<uint32_t>(range / 2));
    };
    std::vector<InTriangle> triangles(400);
    for (uint32_t i = 0; i < triangles.size(); ++i) {
      InTriangle& t = triangles[i];
      t.origin = i;
      for (size_t c = 0; c < 3; ++c) {
        t.positions[c] = {coordinate(), coordinate(), coordinate()};
        t.vertices[c] = 3 * i + c;
        t.parent_vertices[c] = 3 * i + static_cast<uint32_t>(c);
      }
    }
    const std::vector<InTriangle> before = triangles;
    bool unique = true;
    std::vector<std::pair<std::array<Vec3i, 3>, uint32_t>> expected;
    for (const InTriangle& t : before) {
      std::set<std::array<Vec3i, 3>> rotations;
      for (size_t r = 0; r < 3; ++r) rotations.insert(Rotated(t.positions, r));
      unique &= rotations.size() == 3;
      expected.emplace_back(*rotations.begin(), t.origin);
    }
    std::sort(expected.begin(), expected.end());
    for (size_t i = 1; i < expected.size(); ++i) {
      unique &= expected[i - 1].first != expected[i].first;
    }
    REQUIRE(SortCanonically(triangles) == unique);
    for (size_t i = 0; i < triangles.size(); ++i) {
      const InTriangle& t = triangles[i];
      REQUIRE(t.positions == expected[i].first);
      REQUIRE(t.origin == expected[i].second);
      const size_t r = t.vertices[0] - 3 * t.origin;
      REQUIRE(Rotated(before[t.origin].positions, r) == t.positions);
      for (size_t c = 0; c < 3; ++c) REQUIRE(t.vertices[c] == t.parent_vertices[c]);
    }
  }
}

}  // namespace
}  // namespace mtdb
