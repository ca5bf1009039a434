// SPDX-License-Identifier: Apache-2.0
// The order in which a round's triangles are cut into tiles.
#include "builder/tiles/tiling.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <set>

namespace mtdb::testing {

using namespace internal;

namespace {

const Box3d kBounds{{-3, 5, 0}, {7, 6, 0.01}};

Grid GridOf(const Box3d& bounds) {
  Grid grid;
  grid.origin = bounds.min;
  grid.step = 1e-4;
  return grid;
}

// Points, that is, anywhere in kBounds.
std::vector<TileTriangle> RandomTriangles(size_t count, const Grid& grid) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<TileTriangle> triangles(count);
  for (TileTriangle& t : triangles) {
    Vec3d p;
    for (int a = 0; a < 3; ++a) {
      p[a] = kBounds.min[a] + (kBounds.max[a] - kBounds.min[a]) * uniform(random);
    }
    t.positions.fill(grid.Quantize(p));
  }
  return triangles;
}

}  // namespace

TEST_CASE("Every round has a curve of its own, and codes stay in range up to the corners") {
  const Grid grid = GridOf(kBounds);
  std::set<uint64_t> codes;
  TileTriangle inside;
  for (Vec3i& p : inside.positions) p = {50000, 5000, 50};
  for (uint32_t round = 0; round < 60; ++round) {
    const RoundCurve curve(kBounds, round);
    codes.insert(curve.Code(inside, grid));
    for (const Vec3i corner : {Vec3i{0, 0, 0}, Vec3i{100000, 10000, 100}, Vec3i{100000, 0, 0}}) {
      TileTriangle t;
      for (Vec3i& p : t.positions) p = corner;
      REQUIRE(curve.Code(t, grid) >> 63 == 0);
    }
    REQUIRE(curve.Code(inside, grid) == RoundCurve(kBounds, round).Code(inside, grid));
  }
  REQUIRE(codes.size() == 60);
}

TEST_CASE("Neighbours on the curve are neighbours in space") {
  const Grid grid = GridOf(kBounds);
  std::vector<TileTriangle> triangles = RandomTriangles(20000, grid);
  const RoundCurve curve(kBounds, 1);
  std::sort(triangles.begin(), triangles.end(), [&](const TileTriangle& t, const TileTriangle& u) {
    return curve.Code(t, grid) < curve.Code(u, grid);
  });
  // Tiles of 200 of a slab of 10 x 1: a hundredth of its area each.
  double sum = 0;
  for (size_t tile = 0; tile < 100; ++tile) {
    const auto [begin, end] = TileRange(triangles.size(), 100, tile);
    Box3d box;
    for (uint64_t i = begin; i < end; ++i) box.Add(grid.Position(triangles[i].positions[0]));
    sum += (box.max.x - box.min.x) * (box.max.y - box.min.y);
  }
  REQUIRE(sum < 6 * 10.0);  // 1,000 in random order
}

TEST_CASE("Surfaces without extent have codes too") {
  Box3d point;
  point.Add(Vec3d{1, 2, 3});
  TileTriangle t;
  REQUIRE(RoundCurve(point, 5).Code(t, GridOf(point)) >> 63 == 0);
}

TEST_CASE("Tiles cover all triangles once and are of nearly equal size") {
  for (const uint64_t triangles : {uint64_t{0}, uint64_t{7}, uint64_t{1000003}}) {
    for (const uint64_t tiles : {uint64_t{1}, uint64_t{3}, uint64_t{122}}) {
      uint64_t at = 0;
      for (uint64_t i = 0; i < tiles; ++i) {
        const auto [begin, end] = TileRange(triangles, tiles, i);
        REQUIRE(begin == at);
        REQUIRE(end - begin <= triangles / tiles + 1);
        REQUIRE(end - begin >= triangles / tiles);
        at = end;
      }
      REQUIRE(at == triangles);
    }
  }
}

}  // namespace mtdb::testing
