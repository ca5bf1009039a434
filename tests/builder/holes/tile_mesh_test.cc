// SPDX-License-Identifier: Apache-2.0
#include "builder/holes/tile_mesh.h"

#include <catch2/catch.hpp>
#include <random>

namespace mtdb::testing {

using namespace internal;

TEST_CASE("Half-edges are paired once, and never where an edge is used twice in one direction") {
  std::mt19937 random(5);
  for (int i = 0; i < 500; ++i) {
    const auto vertices = static_cast<uint32_t>(4 + random() % 8);
    std::vector<std::array<uint32_t, 3>> soup;
    for (size_t t = 0; t < 1 + random() % 20; ++t) {
      const auto a = static_cast<uint32_t>(random() % vertices);
      const auto b = static_cast<uint32_t>(random() % vertices);
      const auto c = static_cast<uint32_t>(random() % vertices);
      if (a != b && b != c && c != a) soup.push_back({a, b, c});
    }
    std::vector<uint32_t> opposite;
    PairHalfEdges(soup, vertices, opposite);
    REQUIRE(opposite.size() == 3 * soup.size());
    const auto from = [&](uint32_t h) { return soup[h / 3][h % 3]; };
    const auto to = [&](uint32_t h) { return soup[h / 3][(h + 1) % 3]; };
    for (uint32_t h = 0; h < opposite.size(); ++h) {
      uint32_t same = 0;
      uint32_t reverse = 0;
      uint32_t twin = kNone32;
      for (uint32_t g = 0; g < opposite.size(); ++g) {
        same += from(g) == from(h) && to(g) == to(h);
        if (from(g) != to(h) || to(g) != from(h)) continue;
        ++reverse;
        twin = g;
      }
      REQUIRE(opposite[h] == (same == 1 && reverse == 1 ? twin : kNone32));
    }
  }
}

// Comparing all edges at the vertex with each other would take hours.
TEST_CASE("Half-edges are paired around a vertex of a million triangles") {
  constexpr uint32_t kCount = 1'000'000;
  std::vector<std::array<uint32_t, 3>> fan;
  for (uint32_t i = 1; i <= kCount; ++i) fan.push_back({0, i, i % kCount + 1});
  std::vector<uint32_t> opposite;
  PairHalfEdges(fan, kCount + 1, opposite);
  for (uint32_t t = 0; t < kCount; ++t) {
    const uint32_t next = (t + 1) % kCount;
    const bool paired = opposite[3 * t + 2] == 3 * next && opposite[3 * next] == 3 * t + 2;
    if (!paired || opposite[3 * t + 1] != kNone32) FAIL("triangle " << t);
  }
}

}  // namespace mtdb::testing
