// SPDX-License-Identifier: Apache-2.0
// RasterSurface's curves against those that RoundMesh finds on the same surface by walking.
#include <catch2/catch.hpp>
#include <random>

#include "builder/holes/tile_mesh.h"
#include "builder/measure/raster_surface.h"
#include "builder/measure/round_mesh.h"

namespace mtdb::testing {

using namespace internal;

namespace {

struct Raster {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<float> errors;
};

// All cells of columns x rows samples are cut the same way; one in `gap` cells is left out, 0:
// none.
Raster RandomRaster(int columns, int rows, bool falls, uint32_t gap, std::mt19937& random) {
  Raster r;
  const Vec3d origin{-7, 1000, 0};
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const auto z = static_cast<int32_t>(random() % 4001) - 2000;
      r.positions.push_back(origin + ToDouble(Vec3i{x, y, z}));
    }
  }
  const auto at = [&](int x, int y) { return static_cast<uint32_t>(y * columns + x); };
  for (int y = 0; y + 1 < rows; ++y) {
    for (int x = 0; x + 1 < columns; ++x) {
      if (gap != 0 && random() % gap == 0) continue;
      const uint32_t a = at(x, y), b = at(x + 1, y), c = at(x + 1, y + 1), d = at(x, y + 1);
      if (falls) {
        r.triangles.push_back({a, b, d});
        r.triangles.push_back({b, c, d});
      } else {
        r.triangles.push_back({a, b, c});
        r.triangles.push_back({a, c, d});
      }
    }
  }
  r.errors.assign(r.triangles.size(), 0);
  return r;
}

bool Build(RasterSurface& surface, const Raster& r) {
  return surface.Build(r.triangles, r.positions, r.errors);
}

// How many edges between two samples have a curve; all of them must be the same.
size_t CompareCurves(const Raster& r) {
  RasterSurface surface;
  REQUIRE(Build(surface, r));
  RoundMesh walked;
  std::vector<uint32_t> opposites;
  PairHalfEdges(r.triangles, static_cast<uint32_t>(r.positions.size()), opposites);
  walked.Build(r.triangles, opposites, r.positions, r.errors);
  std::vector<bool> used(r.positions.size());
  for (const auto& t : r.triangles) {
    for (const uint32_t v : t) used[v] = true;
  }
  size_t curves = 0;
  for (uint32_t a = 0; a < r.positions.size(); ++a) {
    for (uint32_t b = 0; b < r.positions.size(); ++b) {
      if (a == b || !used[a] || !used[b]) continue;
      const double expected = walked.CurveError(a, b);
      const double found = surface.CurveError(r.positions[a], r.positions[b]);
      if (expected < 0) continue;
      ++curves;
      if (found != expected)
        FAIL("from " << a << " to " << b << ": " << found << ", not " << expected);
    }
  }
  return curves;
}

}  // namespace

TEST_CASE("edges over a raster have the curves that a walk over its triangles finds", "[oracle]") {
  std::mt19937 random(5);
  for (const bool falls : {false, true}) {
    for (int trial = 0; trial < 4; ++trial) {
      const int columns = 2 + static_cast<int>(random() % 12);
      const int rows = 2 + static_cast<int>(random() % 12);
      CompareCurves(RandomRaster(columns, rows, falls, 0, random));
    }
    REQUIRE(CompareCurves(RandomRaster(15, 9, falls, 0, random)) > 10000);
    REQUIRE(CompareCurves(RandomRaster(15, 15, falls, 8, random)) > 1000);
  }
}

TEST_CASE("an edge that leaves the raster, or is too long, has no curve") {
  std::mt19937 random(6);
  Raster r = RandomRaster(300, 3, true, 0, random);
  RasterSurface surface;
  REQUIRE(Build(surface, r));
  const auto curve = [&](int ax, int ay, int bx, int by) {
    const auto at = [](int x, int y) { return static_cast<size_t>(y * 300 + x); };
    return surface.CurveError(r.positions[at(ax, ay)], r.positions[at(bx, by)]);
  };
  REQUIRE(curve(0, 2, 2, 2) >= 0);
  REQUIRE(curve(0, 0, 2, 0) < 0);  // samples on an edge count as left of it: nothing on its right
  REQUIRE(curve(0, 1, 80, 1) >= 0);
  REQUIRE(curve(0, 1, 299, 1) < 0);
}

TEST_CASE("what is no raster at full resolution has no table of heights") {
  std::mt19937 random(7);
  const Raster whole = RandomRaster(6, 5, true, 0, random);
  RasterSurface surface;
  REQUIRE(Build(surface, whole));
  Raster other = whole;
  SECTION("no triangle") {
    other.triangles.clear();
    other.errors.clear();
  }
  SECTION("a cell that is cut by the other diagonal") {
    const auto [a, b, d] = whole.triangles[0];
    const uint32_t c = whole.triangles[1][1];
    other.triangles[0] = {a, b, c};
    other.triangles[1] = {a, c, d};
  }
  SECTION("a triangle over more than a cell") { other.triangles[0][1] += 1; }
  SECTION("a triangle without area") { other.triangles[0][1] = other.triangles[0][0]; }
  SECTION("two heights at one place") {
    other.positions.push_back(other.positions[whole.triangles[0][1]] + Vec3d{0, 0, 1});
    other.triangles[0][1] = static_cast<uint32_t>(other.positions.size() - 1);
  }
  SECTION("an error") { other.errors[3] = 0.5F; }
  SECTION("samples that are far apart") { other.positions.push_back({4e5, 4e5, 0}); }
  SECTION("numbers that are too large") { other.positions[0].z = 1e9; }
  REQUIRE_FALSE(Build(surface, other));
  REQUIRE(surface.empty());
}

}  // namespace mtdb::testing
