// SPDX-License-Identifier: Apache-2.0
// The surface beneath a tile: put together from what the clusters of the round before left, and
// what errors against it promise.
#include "builder/internal/tile_surface.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "bench/internal/hausdorff.h"
#include "builder/internal/decimator.h"
#include "builder/internal/tile_cluster.h"
#include "builder/internal/tiling.h"
#include "tests/builder/fixture.h"
#include "tests/builder/input_oracle.h"
#include "tests/builder/nasty_meshes.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Corners = std::array<uint32_t, 3>;

const SpoolSpace& Space() {
  static const SpoolSpace kSpace{std::filesystem::temp_directory_path().string()};
  return kSpace;
}

// The same triangle, from its smallest vertex on.
Corners Turned(Corners t) {
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  return t;
}

// A first round of `tiles` tiles, that the second one goes on from.
struct FirstRound {
  FirstRound(const TriangleMesh& mesh, size_t tiles) {
    Box3d bounds;
    for (const Vec3d& p : mesh.positions) bounds.Add(p);
    grid.origin = bounds.min;
    grid.step = Diagonal(bounds) / 30000;
    before = ClassifiedTriangles(mesh, grid);
    const RoundCurve curve(bounds, 1);
    std::stable_sort(before.begin(), before.end(),
                     [&](const TileTriangle& a, const TileTriangle& b) {
                       return curve.Code(a, grid) < curve.Code(b, grid);
                     });
    SurfaceDecimator decimator;
    for (size_t i = 0; i < tiles; ++i) {
      const auto [begin, end] = TileRange(before.size(), tiles, i);
      TriangleBlock tile;
      tile.triangles.assign(before.begin() + static_cast<std::ptrdiff_t>(begin),
                            before.begin() + static_cast<std::ptrdiff_t>(end));
      DecimateOptions options;
      options.target_triangles = static_cast<uint32_t>(tile.triangles.size() / 4);
      options.largest_error = 1e9;
      options.goes_on = true;
      const TileResult result = decimator.Decimate(tile.triangles, grid, options);
      for (const Removal& r : result.removals) removed.push_back(result.vertices[r.vertex]);
      TileCluster cluster = MakeTileCluster(tile, result, grid, {});
      const auto id = static_cast<UnitId>(7 + i);
      REQUIRE(surfaces.Add(id, cluster.surface).ok());
      for (TileTriangle& t : cluster.left.triangles) {
        if (t.child == TileCluster::kOwnCluster) t.child = id;
        after.push_back(t);
      }
    }
    REQUIRE(surfaces.Finish().ok());
  }

  Grid grid;
  std::vector<TileTriangle> before, after;
  std::vector<uint32_t> removed;
  SurfaceSpool surfaces{&Space(), 0};
};

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
  for (const TriangleMesh& mesh : {MakeSculpture(9000), MakeSheet(40, 0.01)}) {
    FirstRound round(mesh, 4);
    TileSurface surface = round.surfaces.Gather(round.after).value();
    std::multiset<Corners> gathered;
    for (const auto& t : surface.triangles) {
      gathered.insert(
          Turned({surface.vertices[t[0]], surface.vertices[t[1]], surface.vertices[t[2]]}));
    }
    for (size_t t = 0; t < round.after.size(); ++t) {
      if (surface.own[t]) gathered.insert(Turned(round.after[t].vertices));
    }
    std::multiset<Corners> expected;
    for (const TileTriangle& t : round.before) expected.insert(Turned(t.vertices));
    REQUIRE(gathered == expected);
    // One may be held by several triangles; a border vertex lies on one curve only.
    std::set<uint32_t> held;
    std::set<uint32_t> on_curves;
    for (const HeldVertex& h : surface.held) {
      held.insert(surface.vertices[h.vertex]);
      if (h.edge != 3) REQUIRE(on_curves.insert(surface.vertices[h.vertex]).second);
    }
    REQUIRE(held == std::set<uint32_t>(round.removed.begin(), round.removed.end()));
    for (const HeldVertex& h : surface.held) {
      REQUIRE(!surface.own[h.triangle]);
      if (h.edge != 3) REQUIRE((round.after[h.triangle].border_edges >> h.edge & 1));
    }
  }
}

TEST_CASE("A part of a round's triangles finds all that lies around what it stands for") {
  FirstRound round(MakeSculpture(9000), 4);
  std::map<uint32_t, int> fans;  // triangles around each vertex
  for (const TileTriangle& t : round.before) {
    for (const uint32_t v : t.vertices) ++fans[v];
  }
  const std::vector<TileTriangle> part(round.after.begin() + 200, round.after.begin() + 1100);
  const TileSurface surface = round.surfaces.Gather(part).value();
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

TEST_CASE("A second round is measured against what the first began with") {
  const TriangleMesh meshes[] = {MakeSculpture(9000), MakeTerrain(6000), MakeSheet(40, 0.01),
                                 MakeSheet(40, 0.05)};
  for (const TriangleMesh& mesh : meshes) {
    FirstRound round(mesh, 4);
    const TileSurface surface = round.surfaces.Gather(round.after).value();
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
    if (&mesh == &meshes[0] || &mesh == &meshes[1]) REQUIRE(beneath < sum);  // of smooth ones
  }
}

}  // namespace mtdb::testing
