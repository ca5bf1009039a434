// SPDX-License-Identifier: Apache-2.0
// The error of each triangle that a removal ever made, against brute force: what it bounds is near,
// all of it.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <random>
#include <span>

#include "builder/decimate/decimator.h"
#include "builder/measure/tile_surface.h"
#include "builder/tiles/tiling.h"
#include "builder/write/tile_cluster.h"
#include "tests/builder/fixture.h"
#include "tests/builder/input_oracle.h"
#include "tests/builder/terrain_seams.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Triangle3 = std::array<Vec3d, 3>;

const SpoolSpace& Space() {
  static const SpoolSpace kSpace{std::filesystem::temp_directory_path().string()};
  return kSpace;
}

Triangle3 Corners(const TileResult& r, size_t t) {
  const auto& c = r.triangles[t];
  return {ToDouble(r.positions[c[0]]), ToDouble(r.positions[c[1]]), ToDouble(r.positions[c[2]])};
}

// A lattice of heights, as triangles.
TriangleMesh Lattice(uint32_t columns, uint32_t rows, int relief, double trend,
                     std::mt19937& random) {
  TriangleMesh mesh;
  for (uint32_t r = 0; r < rows; ++r) {
    for (uint32_t c = 0; c < columns; ++c) {
      const double wave = trend * (std::sin(0.7 * c + 0.2 * r) + std::cos(0.5 * r));
      mesh.positions.push_back({static_cast<double>(c), static_cast<double>(r),
                                std::floor(wave) + static_cast<double>(random() % relief)});
    }
  }
  for (uint32_t r = 0; r + 1 < rows; ++r) {
    for (uint32_t c = 0; c + 1 < columns; ++c) {
      const VertexIndex a = r * columns + c;
      mesh.triangles.push_back({a, a + 1, a + columns});
      mesh.triangles.push_back({a + 1, a + columns + 1, a + columns});
    }
  }
  return mesh;
}

// Requires of each triangle that the removals made that nothing above or below it is farther off
// than its error, less that of the input triangle.
void RequireHeights(const std::vector<TileTriangle>& input, const TileResult& r, size_t first) {
  for (size_t t = first; t < r.triangles.size(); ++t) {
    const Triangle3 made = Corners(r, t);
    for (const TileTriangle& s : input) {
      const double off = HeightDifference(
          made, {ToDouble(s.positions[0]), ToDouble(s.positions[1]), ToDouble(s.positions[2])});
      if (off < 0) continue;
      if (off + s.error > r.errors[t] * (1 + 1e-6) + 1e-6) {
        CAPTURE(t, off, s.error, r.errors[t]);
        REQUIRE(off + s.error <= r.errors[t]);
      }
    }
  }
}

// Rounds of one tile that go on from each other, to so many triangles each. Calls
// f(result, triangles that its round began with) after each.
template <typename F>
void RunRounds(TileDecimator& decimator, std::vector<TileTriangle> tile, const Grid& grid,
               std::span<const size_t> targets, F&& f) {
  std::vector<std::unique_ptr<SurfaceSpool>> surfaces;
  for (const size_t target : targets) {
    const auto round = static_cast<uint32_t>(surfaces.size() + 1);
    const TileSurface surface = GatherSurface(surfaces, tile).value();
    DecimateOptions options;
    options.largest_error = 1e9;
    options.target_triangles = static_cast<uint32_t>(target);
    if (!surface.empty()) options.surface = &surface;
    const TileResult result = decimator.Decimate(tile, grid, options);
    f(result, tile.size());
    if (result.removals.empty()) return;
    TriangleBlock block;
    block.triangles = std::move(tile);
    TileCluster cluster =
        MakeTileCluster(block, {}, result, grid, {}, {},
                        {surface.empty() ? round : surface.round, options.surface});
    surfaces.push_back(std::make_unique<SurfaceSpool>(round, &Space(), 1 << 20));
    REQUIRE(surfaces.back()->Add(4 + round, cluster.surface).ok());
    REQUIRE(surfaces.back()->Finish().ok());
    tile = std::move(cluster.left.triangles);
    for (TileTriangle& t : tile) {
      if (t.child == TileCluster::kOwnCluster) t.child = 4 + round;
    }
  }
}

template <typename TheDecimator>
void CheckTerrains(int runs) {
  std::mt19937 random(1);
  TheDecimator decimator;
  for (int run = 0; run < runs; ++run) {
    const int relief = 1 + static_cast<int>(random() % 12);
    const TriangleMesh mesh = Lattice(12, 11, relief, random() % 3 * 3.0, random);
    Grid grid;
    std::vector<TileTriangle> tile = ClassifiedTriangles(mesh, grid);
    const bool with_errors = run % 2 == 1;
    if (with_errors) {
      for (TileTriangle& t : tile) t.error = static_cast<float>(random() % 50) * 0.1f;
    }
    const size_t first = tile.size() / (1 + random() % 8) - 1;
    CAPTURE(run);
    RunRounds(decimator, tile, grid, std::array{first, first / 2, size_t{2}},
              [&](const TileResult& r, size_t begun) { RequireHeights(tile, r, begun); });
  }
}

// A sheet of cells that are jittered along all three axes, so that stars are far from convex.
TriangleMesh RoughSheet(int n, double jitter, double relief, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  TriangleMesh mesh;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      mesh.positions.push_back({i + jitter * uniform(random), j + jitter * uniform(random),
                                relief * (uniform(random) + std::sin(0.9 * i + 0.3 * j))});
    }
  }
  const auto at = [n](int i, int j) { return static_cast<VertexIndex>(j * (n + 1) + i); };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < n; ++i) {
      if (random() % 2 == 0) {
        mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
        mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
      } else {
        mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
        mesh.triangles.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
      }
    }
  }
  return mesh;
}

// Points of a triangle, its corners among them.
template <typename F>
void ForEachPoint(const Triangle3& t, int parts, F&& f) {
  for (int i = 0; i <= parts; ++i) {
    for (int j = 0; i + j <= parts; ++j) {
      f((t[0] * i + t[1] * j + t[2] * (parts - i - j)) * (1.0 / parts));
    }
  }
}

// How much farther `p` is from the triangles than they allow, at least; at most 0: it is near one.
double Beyond(Vec3d p, const std::vector<Triangle3>& triangles,
              const std::vector<double>& allowed) {
  double least = 1e300;
  for (size_t t = 0; t < triangles.size(); ++t) {
    const auto& [a, b, c] = triangles[t];
    const double d = std::sqrt(SquaredDistancePointTriangle(p, a, b, c)) - allowed[t];
    least = std::min(least, d);
    if (least <= 0) return least;
  }
  return least;
}

// How far a triangle that a removal made goes beyond its error from the input, at most, or, after
// some of the removals, a point of the input from all triangles beyond theirs.
double LargestBreach(const std::vector<TileTriangle>& input, const TileResult& r, size_t first) {
  std::vector<Triangle3> original;
  for (const TileTriangle& s : input) {
    original.push_back(
        {ToDouble(s.positions[0]), ToDouble(s.positions[1]), ToDouble(s.positions[2])});
  }
  double breach = 0;
  for (size_t t = first; t < r.triangles.size(); ++t) {
    const std::vector<double> allowed(original.size(), static_cast<double>(r.errors[t]));
    ForEachPoint(Corners(r, t), 6,
                 [&](Vec3d p) { breach = std::max(breach, Beyond(p, original, allowed)); });
  }
  std::vector<bool> there(r.triangles.size(), false);
  std::fill_n(there.begin(), first, true);
  for (size_t i = 0; i < r.removals.size(); ++i) {
    const Removal& removal = r.removals[i];
    for (uint32_t j = 0; j < removal.star_count; ++j)
      there[r.stars[removal.star_begin + j]] = false;
    for (uint32_t j = 0; j < removal.hole_count; ++j) there[r.holes[removal.hole_begin + j]] = true;
    if (i % 4 != 3 && i + 1 != r.removals.size()) continue;
    std::vector<Triangle3> now;
    std::vector<double> allowed;
    for (size_t t = 0; t < there.size(); ++t) {
      if (!there[t]) continue;
      now.push_back(Corners(r, t));
      allowed.push_back(r.errors[t]);
    }
    for (const Triangle3& s : original) {
      ForEachPoint(s, 3, [&](Vec3d p) { breach = std::max(breach, Beyond(p, now, allowed)); });
    }
  }
  return breach;
}

}  // namespace

// More of them: MTDB_TRIANGLE_RUNS=10000 build-test/tests/builder_test "each triangle of a
// surface*"
TEST_CASE("each triangle of a surface is as near to the input as it says, and the input to it") {
  const char* more = std::getenv("MTDB_TRIANGLE_RUNS");
  const int runs = more != nullptr ? std::atoi(more) : 340;
  SurfaceDecimator decimator;
  Grid grid;
  grid.origin = {-1, -1, -10};
  grid.step = 1e-4;
  for (int run = 0; run < runs; ++run) {
    std::mt19937 random(static_cast<uint32_t>(run));
    const double jitter = 0.2 + 0.1 * (run % 7);
    const double relief = 0.05 * (1 << run % 5);
    const std::vector<TileTriangle> tile =
        ClassifiedTriangles(RoughSheet(8, jitter, relief, random), grid);
    const size_t third = tile.size() / 3;
    double breach = 0;
    const std::array<size_t, 3> targets = {2, 2, 2};
    const std::array<size_t, 3> in_rounds = {2 * third, third, 2};
    RunRounds(decimator, tile, grid, run % 2 == 0 ? targets : in_rounds,
              [&](const TileResult& r, size_t begun) {
                breach = std::max(breach, LargestBreach(tile, r, begun));
              });
    CAPTURE(run, jitter, relief);
    REQUIRE(breach < 1e-3);  // of a grid step
  }
}

// Of points on lines, in any order, so that stars are folded and many triangles are needles or have
// no area.
TEST_CASE("each triangle is as near to the removed vertices at home in it as it says") {
  SurfaceDecimator decimator;
  Grid grid;
  grid.origin = {-1, -1, -10};
  grid.step = 1e-4;
  size_t held = 0;
  for (int run = 0; run < 150; ++run) {
    std::mt19937 random(static_cast<uint32_t>(run));
    TriangleMesh mesh = RoughSheet(10 + 4 * (run % 3), 0, 0, random);
    const int width = 2 + static_cast<int>(random() % 4);
    for (Vec3d& p : mesh.positions) {
      p.x = std::floor(p.x / width);
      if (random() % 2 == 0) p.y = static_cast<double>(random() % 20);
      if (run % 2 == 0 && random() % 3 == 0) p.x = static_cast<double>(random() % 20);
      if (run % 4 == 1) p = {0.8 * p.x - 0.6 * p.y, 0.6 * p.x + 0.8 * p.y, 0};
    }
    const std::vector<TileTriangle> tile = ClassifiedTriangles(mesh, grid);
    for (size_t target = tile.size() / 2; target > 8; target = target * 3 / 4) {
      DecimateOptions options;
      options.largest_error = 1e9;
      options.target_triangles = static_cast<uint32_t>(target);
      const TileResult r = decimator.Decimate(tile, grid, options);
      for (const auto& [vertex, t, edge] : r.held) {
        const auto [a, b, c] = Corners(r, t);
        const Vec3d p = ToDouble(r.positions[vertex]);
        const double distance = std::sqrt(SquaredDistancePointTriangle(p, a, b, c));
        ++held;
        if (distance <= r.errors[t]) continue;
        CAPTURE(run, target, distance, r.errors[t]);
        REQUIRE(distance <= r.errors[t]);
      }
    }
  }
  REQUIRE(held > 50000);
}

// What lies beyond the tip of a needle, close to the lines of two of its sides, is not over it.
TEST_CASE("a needle that points at a removed vertex is no nearer to it than its tip") {
  std::array<int, 28> fibonacci{1, 1};
  for (size_t i = 2; i < fibonacci.size(); ++i) fibonacci[i] = fibonacci[i - 2] + fibonacci[i - 1];
  for (size_t n = 14; n + 1 < fibonacci.size(); ++n) {
    // The ring 0, 1, 2, 3 of a spike 4 that has the vertex 5 in one of its sides. 0, 1 and 2 are
    // nearly in line, the spike as far again behind 2. 1 and 3 are fixed, so that its hole
    // becomes the needle 012 and the triangle 023.
    const int x = fibonacci[n + 1];
    const int y = fibonacci[n];
    const int far = 6 * x;
    const std::array<Vec3i, 10> places = {{{0, 0, 0},
                                           {fibonacci[n - 1], fibonacci[n - 2], 0},
                                           {2 * x, 2 * y, 0},
                                           {x - 2 * y / 5, y + 2 * x / 5, 0},
                                           {3 * x, 3 * y, 0},
                                           {4 * x / 3, 4 * y / 3, 0},
                                           {-far, 0, -far},
                                           {x, -far, far},
                                           {far, -far / 3, -far},
                                           {0, far, far}}};
    std::vector<TileTriangle> tile;
    const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
      TileTriangle& t = tile.emplace_back();
      t.vertices = {a, b, c};
      for (uint32_t i = 0; i < 3; ++i) {
        t.positions[i] = places[t.vertices[i]];
        if (t.vertices[i] >= 1 && t.vertices[i] <= 3) t.set_fixed(i, true);
      }
    };
    for (const auto& [a, b, c] :
         {std::array{0u, 1u, 4u}, {1, 2, 4}, {2, 3, 4}, {3, 0, 5}, {4, 3, 5}, {0, 4, 5}}) {
      add(a, b, c);
    }
    for (uint32_t i = 0; i < 4; ++i) {
      const uint32_t next = (i + 1) % 4;
      add(next, i, 6 + i);
      add(next, 6 + i, 6 + next);
    }
    SurfaceDecimator decimator;
    DecimateOptions options;
    options.largest_error = 1e9;
    options.target_triangles = 10;
    const TileResult r = decimator.Decimate(tile, Grid{}, options);
    REQUIRE(r.removals.size() == 2);
    REQUIRE(LargestBreach(tile, r, tile.size()) < 1e-3);
  }
}

TEST_CASE("each triangle of a terrain is as near to what lies above and below it as it says") {
  SECTION("free") { CheckTerrains<FreeTerrainDecimator>(400); }
  SECTION("Delaunay") { CheckTerrains<internal::TerrainDecimator>(400); }
}

}  // namespace mtdb::testing
