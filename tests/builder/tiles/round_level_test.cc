// SPDX-License-Identifier: Apache-2.0
// Where the tiles of a round end, and that rounds shrink whatever the mesh.
#include "builder/tiles/round_level.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>

#include "builder/tiles/tiling.h"
#include "tests/builder/fixture.h"
#include "tests/builder/input_oracle.h"
#include "tests/builder/nasty_meshes.h"

namespace mtdb::testing {

using namespace internal;

namespace {

// A sheet that is flat but for a patch of rough ground in one corner.
TriangleMesh MakeRoughCorner(uint32_t side) {
  TriangleMesh mesh = MakeSheet(side, 0);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> height(0, 0.05);
  Box3d bounds;
  for (const Vec3d& p : mesh.positions) bounds.Add(p);
  for (Vec3d& p : mesh.positions) {
    const Vec3d place = p - bounds.min;
    const Vec3d size = bounds.max - bounds.min;
    if (place.x < 0.3 * size.x && place.y < 0.3 * size.y) p.z += height(random) * size.x;
  }
  return mesh;
}

RoundLevel LevelOf(const TriangleMesh& mesh, uint32_t reduction) {
  Grid grid;
  Box3d bounds;
  for (const Vec3d& p : mesh.positions) bounds.Add(p);
  grid.origin = bounds.min;
  grid.step = 1e-5 * Diagonal(bounds);
  const std::vector<TileTriangle> triangles = ClassifiedTriangles(mesh, grid);
  const RoundCurve curve(bounds, 1);
  RoundLevel level(triangles.size(), reduction, 12);
  for (const TileTriangle& t : triangles) level.Sample(t, curve.Code(t, grid));
  SurfaceDecimator decimator;
  level.Begin(decimator, grid, 1e5 / 16);
  return level;
}

}  // namespace

TEST_CASE("Rounds leave about a quarter of their triangles, as planned from a sample") {
  for (const uint64_t triangles : {20000, 150000}) {
    for (const TriangleMesh& mesh : {MakeSculpture(triangles), MakeTerrain(triangles)}) {
      const BuiltObject built = Build(mesh);
      double left = 1;
      for (const RoundReport& round : built.record.rounds) {
        if (round.tiles == 1) break;
        left /= 4;
        const auto part =
            static_cast<double>(round.triangles_out) / static_cast<double>(built.record.triangles);
        CHECK(part > 0.6 * left);
        CHECK(part < 1.5 * left);
      }
      REQUIRE(left < 1);
    }
  }
}

TEST_CASE("Rounds shrink geometrically where errors tell nothing of how much goes") {
  // Flat and rough ground; rough ground alone; flat ground alone.
  for (const TriangleMesh& mesh :
       {MakeRoughCorner(160), MakeSheet(160, 0.003), MakeSheet(160, 0)}) {
    const BuiltObject built = Build(mesh);
    uint64_t triangles = built.record.triangles;
    uint64_t all = 0;
    for (const RoundReport& round : built.record.rounds) {
      all += round.triangles_in;
      if (round.tiles == 1) break;
      // Half of a tile at most, and what its seam keeps.
      CHECK(10 * round.triangles_out < 6 * triangles);
      triangles = round.triangles_out;
    }
    CHECK(all < 2 * built.record.triangles);
    CHECK(built.record.root_triangles < 500);
  }
}

TEST_CASE("Smooth tiles are reduced further than rough ones") {
  const TriangleMesh mesh = MakeRoughCorner(200);
  BuildOptions options;
  options.tile_triangles = 4096;
  const BuiltObject built = Build(mesh, options);
  const std::vector<RoundReport>& rounds = built.record.rounds;
  REQUIRE(rounds[0].tiles > 8);
  std::vector<uint64_t> nodes;  // of the first round's clusters
  for (UnitId id = 0; id < rounds[0].clusters; ++id) {
    nodes.push_back(built.surface->index().unit(id).nodes);
  }
  const auto [least, most] = std::minmax_element(nodes.begin(), nodes.end());
  REQUIRE(2 * *least < *most * 3 / 2);
}

TEST_CASE("The level of a round grows as rounds lag behind, within bounds") {
  const TriangleMesh mesh = MakeSculpture(60000);
  const auto n = static_cast<double>(mesh.triangles.size());
  const auto after = [&](double left) {
    RoundLevel level = LevelOf(mesh, 4);
    const double first = level.error();
    REQUIRE(first > 0);
    level.Next(static_cast<uint64_t>(left));
    return level.error() / first;
  };
  REQUIRE(after(n / 4) == Approx(std::pow(4, 0.93)).epsilon(0.01));
  REQUIRE(after(n / 3) > 1.2 * after(n / 4));
  REQUIRE(after(n) == Approx(after(0.99 * n)).epsilon(0.02));  // sixteenfold at most
  REQUIRE(after(n / 100) == Approx(std::pow(2, 0.93)));        // twofold at least
  RoundLevel level = LevelOf(mesh, 4);
  for (int round = 0; round < 100; ++round) level.Next(mesh.triangles.size());
  REQUIRE(level.error() == 1e5 / 16);  // the largest error
}

TEST_CASE("The sample of a large mesh gives nearly the level that all of it gives") {
  const TriangleMesh mesh = MakeSculpture(300000);
  Grid grid;
  Box3d bounds;
  for (const Vec3d& p : mesh.positions) bounds.Add(p);
  grid.origin = bounds.min;
  grid.step = 1e-5 * Diagonal(bounds);
  const std::vector<TileTriangle> triangles = ClassifiedTriangles(mesh, grid);
  std::vector<double> guesses = SurfaceDecimator().FirstGuesses(triangles, grid);
  std::sort(guesses.begin(), guesses.end());
  const double whole = 3.3 * guesses[guesses.size() * 3 / 4];
  REQUIRE(LevelOf(mesh, 4).error() == Approx(whole).epsilon(0.25));
}

TEST_CASE("A tile is decimated to its round's level, within a half and a sixteenth") {
  RoundLevel level = LevelOf(MakeSculpture(20000), 4);
  const RemovalLimits limits = level.Limits(8000, false);
  REQUIRE(limits.level_error == level.error());
  REQUIRE(limits.level_triangles == 4000);
  REQUIRE(limits.target_triangles == 500);
  REQUIRE(limits.degree_limit == 12);
  // One tile has nothing to be in step with.
  REQUIRE(level.Limits(8000, true).target_triangles == 2000);
  REQUIRE(level.Limits(8000, true).level_triangles == 0);
  REQUIRE(RoundLevel::MostLeft(4) == 0.5);
}

}  // namespace mtdb::testing
