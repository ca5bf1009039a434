// SPDX-License-Identifier: Apache-2.0
// The surface beneath a tile: put together from what the clusters of rounds before left, and
// what errors against it promise.
#include "builder/measure/tile_surface.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <memory>
#include <numbers>
#include <random>
#include <set>

#include "bench/internal/hausdorff.h"
#include "builder/decimate/decimator.h"
#include "builder/tiles/tiling.h"
#include "builder/write/tile_cluster.h"
#include "tests/builder/fixture.h"
#include "tests/builder/input_oracle.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/builder/rounds.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Corners = std::array<uint32_t, 3>;

// The same triangle, from its smallest vertex on.
Corners Turned(Corners t) {
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

TriangleMesh AsMesh(const std::vector<std::array<Vec3i, 3>>& triangles) {
  TriangleMesh mesh;
  for (const auto& t : triangles) {
    const auto first = static_cast<VertexIndex>(mesh.positions.size());
    for (const Vec3i p : t) mesh.positions.push_back(ToDouble(p));
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

}  // namespace

TEST_CASE("What clusters left is, beneath one tile, the surface that their round began with") {
  const int more_rounds = GENERATE(0, 1, 2);
  for (const TriangleMesh& mesh : {MakeSculpture(20000), MakeSheet(60, 0.003)}) {
    Rounds rounds(mesh, 4);
    for (int i = 0; i < more_rounds; ++i) rounds.Run(static_cast<size_t>(3 - i));
    CAPTURE(more_rounds, mesh.triangles.size());
    const TileSurface surface = GatherSurface(rounds.surfaces, rounds.after).value();
    REQUIRE(surface.round == 1);
    std::multiset<Corners> gathered;
    for (const auto& t : surface.triangles) {
      gathered.insert(
          Turned({surface.vertices[t[0]], surface.vertices[t[1]], surface.vertices[t[2]]}));
    }
    for (size_t t = 0; t < rounds.after.size(); ++t) {
      if (surface.own[t]) gathered.insert(Turned(rounds.after[t].vertices));
    }
    std::multiset<Corners> expected;
    for (const TileTriangle& t : rounds.before) expected.insert(Turned(t.vertices));
    REQUIRE(gathered == expected);
    std::set<uint32_t> held;
    for (const HeldVertex& h : surface.held) {
      REQUIRE(held.insert(surface.vertices[h.vertex]).second);
    }
    REQUIRE(held == std::set<uint32_t>(rounds.removed.begin(), rounds.removed.end()));
    for (const HeldVertex& h : surface.held) {
      REQUIRE(!surface.own[h.triangle]);
      if (h.edge != 3) REQUIRE(rounds.after[h.triangle].order(h.edge) != 0);
    }
  }
}

// Comparing all triangles at the vertex with each other would take minutes.
TEST_CASE("What lies beneath a vertex of 200,000 triangles is put together") {
  constexpr uint32_t kCount = 200'000;
  std::mt19937 random(3);
  TriangleMesh fan;
  fan.positions.push_back({0, 0, 0.3});
  for (uint32_t i = 1; i <= kCount; ++i) {
    const double angle = 2 * std::numbers::pi * i / kCount;
    const double radius = 1 + 1e-3 * static_cast<double>(random() % 100);
    fan.positions.push_back({radius * std::cos(angle), radius * std::sin(angle), 0});
    fan.triangles.push_back({0, i, i % kCount + 1});
  }
  Rounds rounds(fan, 32);
  rounds.Run(16);
  rounds.Run(8);
  const TileSurface surface = GatherSurface(rounds.surfaces, rounds.after).value();
  const auto own = std::count(surface.own.begin(), surface.own.end(), uint8_t{1});
  REQUIRE(surface.triangles.size() + static_cast<size_t>(own) == kCount);
}

TEST_CASE("Where a tile began afresh, only tiles that lie on what it left go on") {
  Rounds rounds(MakeSculpture(20000), 4);
  rounds.Run(3, [](size_t tile) { return tile == 1; });
  REQUIRE(GatherSurface(rounds.surfaces, rounds.after).value().empty());
  std::vector<TileTriangle> first, second;  // of tiles 0 and 1
  for (const TileTriangle& t : rounds.after) {
    if (t.child == 11) first.push_back(t);
    if (t.child == 12) second.push_back(t);
  }
  REQUIRE(GatherSurface(rounds.surfaces, first).value().round == 1);
  REQUIRE(GatherSurface(rounds.surfaces, second).value().round == 2);
  // What an older cluster removes is a triangle of that surface itself.
  for (const TileTriangle& t : rounds.after) {
    if (t.child < 11) second.push_back(t);
  }
  const TileSurface with_older = GatherSurface(rounds.surfaces, second).value();
  REQUIRE(with_older.round == 2);
  REQUIRE(with_older.own.back() == 1);
  // Of a window that is over nothing is kept.
  rounds.surfaces.erase(rounds.surfaces.begin());
  REQUIRE(GatherSurface(rounds.surfaces, first).value().empty());
}

TEST_CASE("A window that is over stands in the way of none that began after it") {
  Rounds rounds(MakeSculpture(20000), 4);
  rounds.Run(4, {}, true);                     // clusters 11 to 14
  rounds.Run(4, [](size_t) { return true; });  // 15 to 18
  const auto made_by = [&](UnitId first, UnitId last) {
    std::vector<TileTriangle> triangles;
    for (const TileTriangle& t : rounds.after) {
      if (t.child != kNone32 && t.child >= first && t.child <= last) triangles.push_back(t);
    }
    REQUIRE(!triangles.empty());
    return triangles;
  };
  REQUIRE(GatherSurface(rounds.surfaces, made_by(11, 14)).value().empty());
  const TileSurface surface = GatherSurface(rounds.surfaces, made_by(11, 18)).value();
  REQUIRE(surface.round == 3);
  REQUIRE(std::count(surface.own.begin(), surface.own.end(), uint8_t{1}) ==
          static_cast<std::ptrdiff_t>(made_by(11, 14).size()));
}

TEST_CASE("A surface is not gone on from where it is too fine") {
  TileSurface surface;
  REQUIRE(!IsWorthGoingOn(surface, false));
  REQUIRE(!IsWorthGoingOn(surface, true));
  surface.own.resize(100);
  surface.triangles.resize(2400);
  REQUIRE(IsWorthGoingOn(surface, true));
  surface.triangles.resize(2401);
  REQUIRE(!IsWorthGoingOn(surface, true));
  surface.triangles.resize(kMostSurface);
  REQUIRE(IsWorthGoingOn(surface, false));
  surface.triangles.resize(kMostSurface + 1);
  REQUIRE(!IsWorthGoingOn(surface, false));
  // Or where its edges run over too many triangles.
  surface.triangles.resize(100);
  surface.chords.resize(1600);
  REQUIRE(IsWorthGoingOn(surface, false));
  surface.chords.resize(1601);
  REQUIRE(!IsWorthGoingOn(surface, false));
}

TEST_CASE("A part of a round's triangles finds all that lies around what it stands for") {
  Rounds round(MakeSculpture(9000), 4);
  std::map<uint32_t, int> fans;  // triangles around each vertex
  for (const TileTriangle& t : round.before) {
    for (const uint32_t v : t.vertices) ++fans[v];
  }
  const std::vector<TileTriangle> part(round.after.begin() + 200, round.after.begin() + 1100);
  const TileSurface surface = GatherSurface(round.surfaces, part).value();
  std::map<uint32_t, int> found;
  for (const auto& t : surface.triangles) {
    for (const uint32_t v : t) ++found[surface.vertices[v]];
  }
  for (size_t t = 0; t < part.size(); ++t) {
    if (!surface.own[t]) continue;
    for (const uint32_t v : part[t].vertices) ++found[v];
  }
  REQUIRE(surface.held.size() > 500);
  for (const HeldVertex& h : surface.held) {
    REQUIRE(found[surface.vertices[h.vertex]] == fans[surface.vertices[h.vertex]]);
  }
}

TEST_CASE("Later rounds are measured against what the first began with") {
  const int more_rounds = GENERATE(0, 1);
  const TriangleMesh meshes[] = {MakeSculpture(9000), MakeTerrain(6000), MakeSheet(40, 0.01),
                                 MakeSheet(40, 0.05)};
  for (const TriangleMesh& mesh : meshes) {
    Rounds round(mesh, 4);
    for (int i = 0; i < more_rounds; ++i) round.Run(2);
    const TileSurface surface = GatherSurface(round.surfaces, round.after).value();
    DecimateOptions options;
    options.target_triangles = static_cast<uint32_t>(round.after.size() / 4);
    options.largest_error = 1e9;
    SurfaceDecimator decimator;
    const auto run = [&](const TileSurface* beneath) {
      options.surface = beneath;
      const TileResult r = decimator.Decimate(round.after, round.grid, options);
      double promised = 0;
      std::vector<std::array<Vec3i, 3>> left;
      for (size_t t = 0; t < r.triangles.size(); ++t) {
        if (!r.alive[t]) continue;
        promised = std::max(promised, static_cast<double>(r.errors[t]));
        const auto& c = r.triangles[t];
        left.push_back({r.positions[c[0]], r.positions[c[1]], r.positions[c[2]]});
      }
      std::vector<std::array<Vec3i, 3>> input;
      for (const TileTriangle& t : round.before) input.push_back(t.positions);
      const double measured = SymmetricHausdorff(AsMesh(input), AsMesh(left), 20000);
      REQUIRE(measured <= promised);
      return promised;
    };
    const double beneath = run(&surface);
    const double sum = run(nullptr);
    if (&mesh == &meshes[0] || (&mesh == &meshes[1] && more_rounds == 0)) REQUIRE(beneath < sum);
  }
}

TEST_CASE("Paths do not get long where any home is as good as any other") {
  // A plate of n^2 cells in rings, each three times as large as the one before: all but the last
  // ones lie in one cell of the grid, where any home is as good as any other.
  constexpr int kCells = 140;
  constexpr int kRings = 21;
  TriangleMesh mesh = MakeSheet(kCells, 0);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (Vec3d& p : mesh.positions) p = (p - Vec3d{0.5, 0.5, 0}) * 1e-3;
  const auto at = [](int i, int j) { return static_cast<VertexIndex>(j * (kCells + 1) + i); };
  std::vector<VertexIndex> inner;
  for (int i = 0; i < kCells; ++i) inner.push_back(at(i, 0));
  for (int i = 0; i < kCells; ++i) inner.push_back(at(kCells, i));
  for (int i = kCells; i > 0; --i) inner.push_back(at(i, kCells));
  for (int i = kCells; i > 0; --i) inner.push_back(at(0, i));
  const size_t k = inner.size();
  double height = 1e-3;
  for (int ring = 0; ring < kRings; ++ring, height *= 3) {
    std::vector<VertexIndex> outer;
    for (const VertexIndex v : inner) {
      const Vec3d p = mesh.positions[v] * 3;
      outer.push_back(static_cast<VertexIndex>(mesh.positions.size()));
      mesh.positions.push_back({p.x * (1 + 1e-3 * uniform(random)),
                                p.y * (1 + 1e-3 * uniform(random)), height * uniform(random)});
    }
    for (size_t i = 0; i < k; ++i) {
      const size_t next = (i + 1) % k;
      mesh.triangles.push_back({inner[i], outer[i], outer[next]});
      mesh.triangles.push_back({inner[i], outer[next], inner[next]});
    }
    inner = outer;
  }
  // Time is spent with all crossings of a path whenever it changes. Without a limit it has 300.
  Rounds rounds(mesh, 8);
  size_t longest = 0;
  for (int round = 0; round < 3; ++round) {
    const TileSurface surface = GatherSurface(rounds.surfaces, rounds.after).value();
    std::map<std::pair<uint32_t, uint32_t>, size_t> lengths;
    for (const Chord& c : surface.chords) {
      longest = std::max(longest, lengths[{c.from, c.to}]++);
    }
    rounds.Run(size_t{4} >> round);
  }
  CAPTURE(longest);
  REQUIRE(longest > 100);  // or the mesh has none
  REQUIRE(longest < 200);
}

}  // namespace mtdb::testing
