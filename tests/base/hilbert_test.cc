// SPDX-License-Identifier: Apache-2.0
#include "store/base/hilbert.h"

#include <array>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <map>
#include <random>
#include <set>
#include <vector>

namespace mtdb {
namespace {

using Point = std::array<uint32_t, 3>;

int Steps(const Point& a, const Point& b) {
  int steps = 0;
  for (size_t i = 0; i < 3; ++i) {
    steps += std::abs(static_cast<int>(a[i]) - static_cast<int>(b[i]));
  }
  return steps;
}

// The points of a cube of 2^bits points a side, by code.
std::map<uint64_t, Point> CubeByCode(Point corner, int bits) {
  std::map<uint64_t, Point> by_code;
  const uint32_t side = 1u << bits;
  for (uint32_t x = 0; x < side; ++x) {
    for (uint32_t y = 0; y < side; ++y) {
      for (uint32_t z = 0; z < side; ++z) {
        const Point p = {corner[0] + x, corner[1] + y, corner[2] + z};
        by_code[HilbertCode(p)] = p;
      }
    }
  }
  return by_code;
}

TEST_CASE("The curve starts at the origin and stays in 63 bits") {
  REQUIRE(HilbertCode({0, 0, 0}) == 0);
  constexpr uint32_t kLast = (1u << kHilbertBits) - 1;
  std::mt19937 random(1);
  uint64_t largest = 0;
  for (const uint32_t x : {0u, kLast}) {
    for (const uint32_t y : {0u, kLast}) {
      for (const uint32_t z : {0u, kLast}) largest = std::max(largest, HilbertCode({x, y, z}));
    }
  }
  REQUIRE(largest == (uint64_t{1} << 63) - 1);
}

TEST_CASE("Successive points of the curve are neighbours on the grid") {
  const std::map<uint64_t, Point> cube = CubeByCode({0, 0, 0}, 4);
  REQUIRE(cube.size() == 16 * 16 * 16);
  uint64_t expected = 0;
  const Point* previous = nullptr;
  for (const auto& [code, point] : cube) {
    REQUIRE(code == expected++);
    if (previous != nullptr) REQUIRE(Steps(*previous, point) == 1);
    previous = &point;
  }
}

TEST_CASE("An aligned cube anywhere is one unbroken piece of the curve") {
  std::mt19937 random(2);
  for (const int bits : {1, 2, 3}) {
    for (int i = 0; i < 50; ++i) {
      Point corner;
      for (uint32_t& c : corner) c = (random() >> (32 - kHilbertBits)) & ~((1u << bits) - 1);
      const std::map<uint64_t, Point> cube = CubeByCode(corner, bits);
      REQUIRE(cube.size() == size_t{1} << (3 * bits));
      REQUIRE(cube.begin()->first % cube.size() == 0);
      REQUIRE(cube.rbegin()->first - cube.begin()->first == cube.size() - 1);
      const Point* previous = nullptr;
      for (const auto& [code, point] : cube) {
        if (previous != nullptr) REQUIRE(Steps(*previous, point) == 1);
        previous = &point;
      }
    }
  }
}

TEST_CASE("Codes far from the origin are as unlike as the points") {
  std::mt19937 random(3);
  std::map<uint64_t, Point> seen;
  for (int i = 0; i < 20000; ++i) {
    Point p;
    for (uint32_t& c : p) c = random() >> (32 - kHilbertBits);
    const auto [at, added] = seen.emplace(HilbertCode(p), p);
    if (!added) REQUIRE(at->second == p);
  }
}

}  // namespace
}  // namespace mtdb
