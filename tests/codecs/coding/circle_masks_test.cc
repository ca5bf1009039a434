// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/circle_masks.h"

#include <bit>
#include <catch2/catch.hpp>
#include <random>
#include <utility>

using namespace mtdb;
using namespace mtdb::internal;

namespace {

bool IsInside(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  if (Turn(a, b, c) <= 0 || d == a || d == b || d == c) return false;
  const int sign = CircleSign<__int128>(a, b, c, d);
  return sign > 0 || (sign == 0 && TieIsInCircle(a, b, c, d));
}

// Point (x, y) of a window at (from_x, from_y).
bool Has(const Disc& disc, LatticePoint from, int x, int y) {
  const int word = y / 4;
  return disc.InWord(static_cast<int32_t>(from.x), static_cast<int32_t>(from.y) + 4 * word) >>
             (16 * (y % 4) + x) &
         1;
}

}  // namespace

TEST_CASE("a circle and its mask have the points that the Delaunay rule gives them") {
  std::mt19937 random(3);
  CircleMasks masks;
  size_t windows = 0;
  size_t large = 0;
  for (int round = 0; round < 3000; ++round) {
    const int spread = round % 3 == 0 ? 3 : round % 3 == 1 ? 8 : 17;
    const auto pick = [&] {
      return LatticePoint{static_cast<int64_t>(random() % (2 * spread + 1)) + 100,
                          static_cast<int64_t>(random() % (2 * spread + 1)) - 50};
    };
    const LatticePoint a = pick(), b = pick(), c = pick();
    const Circle circle(a, b, c);
    REQUIRE(circle.empty() == (Turn(a, b, c) <= 0));
    const Disc disc = masks.Find(a, b, c);
    (disc.large() ? large : windows) += 1;
    // A window anywhere near.
    const LatticePoint from{a.x - 24 + static_cast<int64_t>(random() % 32),
                            a.y - 24 + static_cast<int64_t>(random() % 32)};
    size_t inside = 0;
    size_t wrong = 0;
    for (int y = -40; y <= 40; ++y) {
      for (int x = -40; x <= 40; ++x) {
        const LatticePoint p{a.x + x, a.y + y};
        const bool expected = IsInside(a, b, c, p);
        wrong += p != a && p != b && p != c && circle.Has(p) != expected;
        if (disc.large()) continue;
        const int64_t column = p.x - from.x, row = p.y - from.y;
        if (column >= 0 && column < 16 && row >= 0 && row < 16) {
          wrong += Has(disc, from, static_cast<int>(column), static_cast<int>(row)) != expected;
        }
        inside += expected;
      }
    }
    REQUIRE(wrong == 0);
    if (disc.large()) continue;
    size_t own = 0;
    for (size_t w = 0; w < 4; ++w) {
      const uint64_t word = disc.OwnWord(w);
      REQUIRE((word == 0 || w < disc.mask->words));
      REQUIRE(word == disc.InWord(disc.x, disc.y + 4 * static_cast<int32_t>(w)));
      own += static_cast<size_t>(std::popcount(word));
    }
    REQUIRE(own == inside);
  }
  REQUIRE(windows > 1000);
  REQUIRE(large > 100);
}
