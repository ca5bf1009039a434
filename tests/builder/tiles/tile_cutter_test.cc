// SPDX-License-Identifier: Apache-2.0
// How a round's mesh is cut into tiles.
#include "builder/tiles/tile_cutter.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <random>
#include <vector>

#include "builder/tiles/tiling.h"

namespace mtdb::testing {

using namespace internal;

namespace {

constexpr size_t kRow = 5;
const Box3d kBounds{{0, 0, 0}, {10, 10, 1}};

Grid MakeGrid() {
  Grid grid;
  grid.origin = kBounds.min;
  grid.step = 1e-4;
  return grid;
}

// Points of a gently curved sheet, numbered by their first vertex, with that number in their rows.
std::vector<TileTriangle> Sheet(size_t count, const Grid& grid) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 10);
  std::vector<TileTriangle> triangles(count);
  for (size_t i = 0; i < count; ++i) {
    const double x = uniform(random);
    const double y = uniform(random);
    triangles[i].vertices.fill(static_cast<uint32_t>(i));
    triangles[i].positions.fill(grid.Quantize({x, y, 0.01 * x * y}));
  }
  return triangles;
}

struct Tile {
  TriangleBlock block;
  uint64_t code = 0;
};

// `skips(i)`: tile i is not read.
template <typename Skips>
std::vector<Tile> CutAll(const std::vector<TileTriangle>& triangles, const Grid& grid,
                         const TileCutter::Options& options, Skips&& skips) {
  const RoundCurve curve(kBounds, options.round);
  const SpoolSpace space{std::filesystem::temp_directory_path().string()};
  TriangleSorter sorter({&space, size_t{64} << 20, kRow, 1});
  for (const TileTriangle& t : triangles) {
    std::array<std::byte, 3 * kRow> rows;
    rows.fill(static_cast<std::byte>(t.vertices[0]));
    REQUIRE(sorter.Add(t, rows.data(), curve.Code(t, grid)).ok());
  }
  REQUIRE(sorter.Finish().ok());
  TileCutter cutter(sorter, curve, grid, options);
  std::vector<Tile> tiles(options.tiles);
  for (size_t i = 0; i < tiles.size(); ++i) {
    REQUIRE(cutter.Next(skips(i) ? nullptr : &tiles[i].block, &tiles[i].code).ok());
  }
  return tiles;
}

bool SameTile(const Tile& a, const Tile& b) {
  const auto& s = a.block.triangles;
  const auto& t = b.block.triangles;
  return a.code == b.code && a.block.rows == b.block.rows && s.size() == t.size() &&
         (s.empty() || std::memcmp(s.data(), t.data(), s.size() * sizeof(TileTriangle)) == 0);
}

}  // namespace

TEST_CASE("Tiles have every triangle once, along the curve, with its rows") {
  const Grid grid = MakeGrid();
  for (const auto& [count, tiles] : {std::pair<size_t, uint64_t>{0, 1},
                                     {1, 1},
                                     {700, 7},
                                     {20'000, 40},
                                     {20'000, 16},
                                     {20'000, 17},
                                     {3001, 2}}) {
    const std::vector<TileTriangle> triangles = Sheet(count, grid);
    for (const uint32_t round : {1u, 2u}) {
      const TileCutter::Options options{tiles, round, std::max<size_t>(64, count / tiles), kRow};
      const RoundCurve curve(kBounds, round);
      std::vector<uint32_t> found;
      uint64_t last_first = 0;
      for (const Tile& tile : CutAll(triangles, grid, options, [](size_t) { return false; })) {
        REQUIRE(tile.block.triangles.size() + 5 >= count / tiles);
        REQUIRE(tile.block.triangles.size() <= count / tiles + 5);
        REQUIRE(tile.block.rows.size() == tile.block.triangles.size() * 3 * kRow);
        if (count == 0) continue;
        REQUIRE(tile.code == curve.Code(tile.block.triangles[0], grid));
        REQUIRE(tile.code >= last_first);
        last_first = tile.code;
        uint64_t last = 0;
        for (size_t i = 0; i < tile.block.triangles.size(); ++i) {
          const TileTriangle& t = tile.block.triangles[i];
          REQUIRE(curve.Code(t, grid) >= last);
          last = curve.Code(t, grid);
          REQUIRE(tile.block.rows[i * 3 * kRow] == static_cast<std::byte>(t.vertices[0]));
          found.push_back(t.vertices[0]);
        }
      }
      std::ranges::sort(found);
      REQUIRE(found.size() == count);
      for (size_t i = 0; i < count; ++i) REQUIRE(found[i] == i);
    }
  }
}

TEST_CASE("A tile is the same whichever tiles before it are skipped") {
  const Grid grid = MakeGrid();
  const std::vector<TileTriangle> triangles = Sheet(30'000, grid);
  const TileCutter::Options options{50, 3, 600, kRow};
  const std::vector<Tile> all = CutAll(triangles, grid, options, [](size_t) { return false; });
  for (const size_t first : {1, 15, 16, 20, 49}) {
    const std::vector<Tile> rest =
        CutAll(triangles, grid, options, [&](size_t i) { return i < first; });
    for (size_t i = first; i < all.size(); ++i) REQUIRE(SameTile(rest[i], all[i]));
  }
}

TEST_CASE("Tiles are more compact than runs of the curve") {
  const Grid grid = MakeGrid();
  const std::vector<TileTriangle> triangles = Sheet(40'000, grid);
  const auto sides = [&](const TileCutter::Options& options) {
    double sum = 0;
    for (const Tile& tile : CutAll(triangles, grid, options, [](size_t) { return false; })) {
      Box3d box;
      for (const TileTriangle& t : tile.block.triangles) box.Add(grid.Position(t.positions[0]));
      sum += box.max.x - box.min.x + box.max.y - box.min.y;
    }
    return sum;
  };
  // One tile a window: runs of the curve.
  const double runs = sides({100, 1, size_t{1} << 20, kRow});
  REQUIRE(TileCutter::WindowTiles(size_t{1} << 20, kRow) == 1);
  REQUIRE(sides({100, 1, 400, kRow}) < 0.85 * runs);
  REQUIRE(sides({100, 1, 400, kRow, true}) < 0.85 * runs);
}

TEST_CASE("A window has fewer tiles where a vertex carries much") {
  REQUIRE(TileCutter::WindowTiles(8192, 0) == 16);
  REQUIRE(TileCutter::WindowTiles(8192, 20) == 14);
  REQUIRE(TileCutter::WindowTiles(8192, 1000) == 1);
  REQUIRE(TileCutter::WindowBytes(8192, 0) <= uint64_t{28} << 20);
}

}  // namespace mtdb::testing
