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

std::array<Vec3i, 3> Corners(const std::array<uint32_t, 3>& t, const std::vector<Vec3i>& p) {
  return {p[t[0]], p[t[1]], p[t[2]]};
}

TEST_CASE("the canonical order is that of the least rotations, whatever the numbers") {
  std::mt19937 random(7);
  // Small ranges make ties; the last one is all of int32.
  for (const uint64_t range : {uint64_t{2}, uint64_t{5}, uint64_t{3000}, uint64_t{1} << 32}) {
    const auto coordinate = [&] {
      return static_cast<int32_t>(static_cast<uint32_t>(random() % range) -
                                  static_cast<uint32_t>(range / 2));
    };
    const auto position = [&] { return Vec3i{coordinate(), coordinate(), coordinate()}; };
    // Vertices that many triangles share, and others.
    std::vector<Vec3i> positions(1000);
    for (Vec3i& p : positions) p = position();
    std::vector<std::array<uint32_t, 3>> triangles(400);
    for (auto& t : triangles) {
      for (uint32_t& v : t) v = static_cast<uint32_t>(random() % positions.size());
    }
    for (uint32_t i = 100; i < 300; ++i) triangles[i][i % 3] = 7;
    bool unique = true;
    std::vector<std::pair<std::array<Vec3i, 3>, uint32_t>> expected;
    for (uint32_t i = 0; i < triangles.size(); ++i) {
      std::set<std::array<Vec3i, 3>> rotations;
      for (size_t r = 0; r < 3; ++r) rotations.insert(Rotated(Corners(triangles[i], positions), r));
      unique &= rotations.size() == 3;
      expected.emplace_back(*rotations.begin(), i);
    }
    std::sort(expected.begin(), expected.end());
    for (size_t i = 1; i < expected.size(); ++i) {
      unique &= expected[i - 1].first != expected[i].first;
    }
    const CanonicalOrder order = SortCanonically(triangles, positions);
    REQUIRE(order.unique == unique);
    REQUIRE(order.slots.size() == triangles.size());
    for (size_t s = 0; s < triangles.size(); ++s) {
      const InSlot slot = order.slots[s];
      REQUIRE(slot.triangle == expected[s].second);
      REQUIRE(Rotated(Corners(triangles[slot.triangle], positions), slot.first_corner) ==
              expected[s].first);
    }
  }
}

}  // namespace
}  // namespace mtdb
