// SPDX-License-Identifier: Apache-2.0
// One tile at a time: what a decimated tile must have in common with what it was.
#include "builder/decimate/decimator.h"

#include <catch2/catch.hpp>

#include "builder/tiles/tiling.h"
#include "store/base/hash.h"
#include "tests/builder/fixture.h"
#include "tests/builder/input_oracle.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {

using namespace internal;

namespace {

using Edge = std::pair<VertexIndex, VertexIndex>;

struct Tiles {
  Grid grid;
  std::vector<std::vector<TileTriangle>> tiles;
};

// The first round's tiles of `mesh`, as the builder makes them; each triangle with `error`.
Tiles MakeTiles(const TriangleMesh& mesh, size_t count, int bits = 12, float error = 0) {
  Tiles result;
  Box3d bounds;
  for (const Vec3d& p : mesh.positions) bounds.Add(p);
  const Vec3d size = bounds.max - bounds.min;
  result.grid.origin = bounds.min;
  result.grid.step = std::max({size.x, size.y, size.z, 1e-300}) / ((1 << bits) - 1);
  std::vector<TileTriangle> triangles = ClassifiedTriangles(mesh, result.grid);
  for (TileTriangle& t : triangles) t.error = error;
  const RoundCurve curve(bounds, 1);
  std::stable_sort(triangles.begin(), triangles.end(),
                   [&](const TileTriangle& a, const TileTriangle& b) {
                     return curve.Code(a, result.grid) < curve.Code(b, result.grid);
                   });
  for (size_t i = 0; i < count; ++i) {
    const auto [begin, end] = TileRange(triangles.size(), count, i);
    result.tiles.emplace_back(triangles.begin() + static_cast<std::ptrdiff_t>(begin),
                              triangles.begin() + static_cast<std::ptrdiff_t>(end));
  }
  return result;
}

// The tile after its first `removals` removals: local triangles that are there.
std::vector<uint32_t> Current(const TileResult& r, size_t input, size_t removals) {
  std::vector<bool> there(r.triangles.size(), false);
  std::fill_n(there.begin(), input, true);
  for (size_t i = 0; i < removals; ++i) {
    const Removal& removal = r.removals[i];
    for (uint32_t j = 0; j < removal.star_count; ++j) {
      REQUIRE(there[r.stars[removal.star_begin + j]]);
      there[r.stars[removal.star_begin + j]] = false;
    }
    for (uint32_t j = 0; j < removal.hole_count; ++j) {
      REQUIRE(!there[r.holes[removal.hole_begin + j]]);
      there[r.holes[removal.hole_begin + j]] = true;
    }
  }
  std::vector<uint32_t> list;
  for (uint32_t t = 0; t < there.size(); ++t) {
    if (there[t]) list.push_back(t);
  }
  return list;
}

// Those triangles as a mesh of their own.
TriangleMesh AsMesh(const TileResult& r, const std::vector<uint32_t>& triangles) {
  TriangleMesh mesh;
  std::map<uint32_t, VertexIndex> number;
  for (const uint32_t t : triangles) {
    TriangleVertices& out = mesh.triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      const auto [at, fresh] = number.try_emplace(r.triangles[t][c], mesh.positions.size());
      if (fresh) mesh.positions.push_back(ToDouble(r.positions[r.triangles[t][c]]));
      out[c] = at->second;
    }
  }
  return mesh;
}

// Directed edges without a partner, by the vertices' global ids; those flagged as the surface's
// border, or those that are not: the seam.
std::set<Edge> Rim(const TileResult& r, const std::vector<uint32_t>& triangles, bool border) {
  std::map<Edge, bool> edges;
  for (const uint32_t t : triangles) {
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t order = r.edge_orders[t] >> 4 * c & 15u;
      if (order > 1) continue;  // other sheets lie beyond
      edges[{r.vertices[r.triangles[t][c]], r.vertices[r.triangles[t][(c + 1) % 3]]}] = order != 0;
    }
  }
  std::set<Edge> rim;
  for (const auto& [e, flagged] : edges) {
    const bool alone = !edges.contains({e.second, e.first});
    if (flagged) REQUIRE(alone);
    if (alone && flagged == border) rim.insert(e);
  }
  return rim;
}

void RequireSameTopology(const std::vector<TileTriangle>& tile, const TileResult& r) {
  const std::vector<uint32_t> before = Current(r, tile.size(), 0);
  const MeshCheck old = CheckMesh(AsMesh(r, before));
  const std::set<Edge> seam = Rim(r, before, false);
  std::set<uint32_t> removed;
  for (const Removal& removal : r.removals) {
    REQUIRE(removed.insert(removal.vertex).second);
    REQUIRE(!r.fixed[removal.vertex]);
    REQUIRE(removal.star_count == removal.hole_count + (removal.fans == 0 ? 2 : removal.fans));
    if (removal.fans < 2) REQUIRE(removal.star_count + removal.fans <= 12);
    for (uint32_t j = 0; j < removal.star_count; ++j) {
      const auto& t = r.triangles[r.stars[removal.star_begin + j]];
      REQUIRE(std::ranges::count_if(
                  t, [&](uint32_t v) { return r.first_twins[v] == removal.vertex; }) == 1);
    }
  }
  for (const Edge& e : seam) {
    for (const uint32_t v : removed) {
      REQUIRE(r.vertices[v] != e.first);
      REQUIRE(r.vertices[v] != e.second);
    }
  }
  for (const size_t prefix : {r.removals.size() / 3, r.removals.size()}) {
    const std::vector<uint32_t> after = Current(r, tile.size(), prefix);
    const MeshCheck now = CheckMesh(AsMesh(r, after));
    REQUIRE(now.euler_characteristic == old.euler_characteristic);
    REQUIRE(now.components == old.components);
    REQUIRE(now.degenerate_triangles == 0);
    REQUIRE(now.duplicate_triangles == old.duplicate_triangles);
    REQUIRE(now.nonmanifold_edges == old.nonmanifold_edges);
    REQUIRE(now.misoriented_edges == old.misoriented_edges);
    REQUIRE(now.nonmanifold_vertices == old.nonmanifold_vertices);
    // Where loops touch, there is more than one way to count them.
    if (old.nonmanifold_vertices == 0) REQUIRE(now.boundary_loops == old.boundary_loops);
    REQUIRE(Rim(r, after, false) == seam);
  }
  const std::vector<uint32_t> last = Current(r, tile.size(), r.removals.size());
  for (uint32_t t = 0; t < r.triangles.size(); ++t) {
    REQUIRE((r.alive[t] != 0) == std::binary_search(last.begin(), last.end(), t));
  }
}

std::array<Vec3d, 3> Corners(const TileResult& r, uint32_t t) {
  return {ToDouble(r.positions[r.triangles[t][0]]), ToDouble(r.positions[r.triangles[t][1]]),
          ToDouble(r.positions[r.triangles[t][2]])};
}

std::vector<Vec3d> SamplePoints(const std::array<Vec3d, 3>& t, int n, std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Vec3d> points;
  for (int i = 0; i < n; ++i) {
    const double a = std::sqrt(uniform(random));
    const double b = uniform(random);
    points.push_back(t[0] * (1 - a) + t[1] * (a * (1 - b)) + t[2] * (a * b));
    points.push_back(t[i % 3] * (1 - b) + t[(i + 1) % 3] * b);  // on an edge
  }
  return points;
}

double Distance(Vec3d p, const TileResult& r, const std::vector<uint32_t>& triangles) {
  double least = std::numeric_limits<double>::infinity();
  for (const uint32_t t : triangles) {
    const std::array<Vec3d, 3> c = Corners(r, t);
    least = std::min(least, SquaredDistancePointTriangle(p, c[0], c[1], c[2]));
  }
  return std::sqrt(least);
}

// Samples both directions between the tile and what became of it. `error`: what each triangle of
// the tile had accumulated before.
void RequireBounds(const std::vector<TileTriangle>& tile, const TileResult& r, double error) {
  std::mt19937 random(3);
  const std::vector<uint32_t> input = Current(r, tile.size(), 0);
  double tightest = 0;
  for (const Removal& removal : r.removals) {
    double largest = 0;
    for (uint32_t j = 0; j < removal.hole_count; ++j) {
      const uint32_t t = r.holes[removal.hole_begin + j];
      largest = std::max<double>(largest, r.errors[t]);
      for (const Vec3d p : SamplePoints(Corners(r, t), 4, random)) {
        const double distance = Distance(p, r, input);
        REQUIRE(distance + error <= static_cast<double>(r.errors[t]) + 1e-4);
        if (r.errors[t] > 1) tightest = std::max(tightest, distance / (r.errors[t] - error));
      }
    }
    REQUIRE(largest >= removal.error);
    REQUIRE(largest <= removal.error * (1 + 1e-6) + 1e-6);
  }
  // The other way: a point of the tile has a current triangle within its promise.
  for (const size_t prefix : {r.removals.size() / 2, r.removals.size()}) {
    const std::vector<uint32_t> current = Current(r, tile.size(), prefix);
    double promise = 0;
    for (const uint32_t t : current) promise = std::max<double>(promise, r.errors[t]);
    for (const uint32_t t : input) {
      for (const Vec3d p : SamplePoints(Corners(r, t), 2, random)) {
        REQUIRE(Distance(p, r, current) + error <= promise + 1e-4);
      }
    }
  }
  if (r.removals.size() > 100) REQUIRE(tightest > 0.6);
}

DecimateOptions To(uint32_t target) {
  DecimateOptions options;
  options.target_triangles = target;
  options.largest_error = 1e9;
  return options;
}

}  // namespace

TEST_CASE("A decimated tile keeps its topology and its seam") {
  SurfaceDecimator decimator;
  std::vector<TriangleMesh> meshes = {MakeSculpture(6000), MakeTerrain(5000)};
  for (const NastyMesh& nasty : NastyMeshes()) meshes.push_back(nasty.mesh);
  uint64_t removals = 0;
  for (const TriangleMesh& mesh : meshes) {
    for (const size_t count : {size_t{1}, size_t{5}}) {
      if (mesh.triangles.size() < 5) continue;
      const Tiles tiles = MakeTiles(mesh, count);
      for (const std::vector<TileTriangle>& tile : tiles.tiles) {
        const TileResult r =
            decimator.Decimate(tile, tiles.grid, To(static_cast<uint32_t>(tile.size() / 5)));
        REQUIRE(r.vertices.size() == r.positions.size());
        REQUIRE(r.triangles.size() == r.errors.size());
        RequireSameTopology(tile, r);
        removals += r.removals.size();
      }
    }
  }
  REQUIRE(removals > 10000);
}

TEST_CASE("The tile's own triangles come first, as they were") {
  const Tiles tiles = MakeTiles(MakeSculpture(4000), 3, 12, 0.5f);
  SurfaceDecimator decimator;
  for (const std::vector<TileTriangle>& tile : tiles.tiles) {
    const TileResult r = decimator.Decimate(tile, tiles.grid, To(0));
    for (uint32_t t = 0; t < tile.size(); ++t) {
      for (size_t c = 0; c < 3; ++c) {
        REQUIRE(r.vertices[r.triangles[t][c]] == tile[t].vertices[c]);
        REQUIRE(r.positions[r.triangles[t][c]] == tile[t].positions[c]);
      }
      REQUIRE(r.errors[t] == 0.5f);
    }
    REQUIRE(r.locked_vertices > 10);
  }
}

TEST_CASE("Each removal's error bounds the sampled distance, both ways") {
  SurfaceDecimator decimator;
  const auto check = [&](const TriangleMesh& mesh, size_t count, int bits, float error) {
    const Tiles tiles = MakeTiles(mesh, count, bits, error);
    const TileResult r = decimator.Decimate(tiles.tiles[0], tiles.grid,
                                            To(static_cast<uint32_t>(tiles.tiles[0].size() / 8)));
    REQUIRE(r.removals.size() > 20);
    RequireBounds(tiles.tiles[0], r, error);
  };
  check(MakeSculpture(3000), 4, 12, 0);
  check(MakeSculpture(3000), 4, 12, 2.5f);
  check(MakeTerrain(1000), 1, 10, 0);
  check(MakeSheet(20, 0.02), 1, 10, 0);
  check(MakeSheet(20, 0.3), 1, 10, 0);  // folds
  check(MakeSheet(20, 0.3), 1, 5, 1);
  // Paper crumpled along its own plane: overhangs everywhere.
  std::mt19937 random(8);
  std::uniform_real_distribution<double> shift(-0.06, 0.06);
  for (uint32_t seed = 1; seed <= 6; ++seed) {
    TriangleMesh crumpled = MakeSheet(20, 0.01, seed);
    for (Vec3d& p : crumpled.positions)
      p += Vec3d{shift(random), shift(random), 0.3 * shift(random)};
    check(crumpled, 1, 12, 0);
  }
}

TEST_CASE("Errors that a tile brings along are part of what its removals promise") {
  Tiles tiles = MakeTiles(MakeSculpture(3000), 2);
  SurfaceDecimator decimator;
  // One bad triangle in the middle: whatever replaces it is at least as bad.
  std::vector<TileTriangle>& tile = tiles.tiles[0];
  tile[tile.size() / 2].error = 77;
  const TileResult r = decimator.Decimate(tile, tiles.grid, To(0));
  uint32_t heirs = 0;
  std::vector<bool> tainted(r.triangles.size(), false);
  tainted[tile.size() / 2] = true;
  for (const Removal& removal : r.removals) {
    bool touched = false;
    for (uint32_t j = 0; j < removal.star_count; ++j) {
      touched |= tainted[r.stars[removal.star_begin + j]];
    }
    if (!touched) continue;
    // Some triangle of the hole stands for a part of the bad one.
    REQUIRE(removal.error >= 77);
    for (uint32_t j = 0; j < removal.hole_count; ++j) {
      const uint32_t t = r.holes[removal.hole_begin + j];
      tainted[t] = r.errors[t] >= 77;
    }
    ++heirs;
  }
  REQUIRE(heirs > 0);
}

TEST_CASE("Decimation stops at its target and at its largest error") {
  const Tiles tiles = MakeTiles(MakeSculpture(4000), 2);
  const std::vector<TileTriangle>& tile = tiles.tiles[0];
  SurfaceDecimator decimator;
  const auto n = static_cast<uint32_t>(tile.size());
  const TileResult half = decimator.Decimate(tile, tiles.grid, To(n / 2));
  const size_t left = Current(half, n, half.removals.size()).size();
  REQUIRE(left <= n / 2);
  REQUIRE(left + 2 >= n / 2);
  DecimateOptions options = To(0);
  options.largest_error = 3;
  const TileResult careful = decimator.Decimate(tile, tiles.grid, options);
  REQUIRE(careful.removals.size() > 100);
  for (const Removal& removal : careful.removals) REQUIRE(removal.error <= 3);
  REQUIRE(decimator.Decimate(tile, tiles.grid, To(n)).removals.empty());
}

TEST_CASE("Decimation stops at its level, once few enough triangles are left") {
  const Tiles tiles = MakeTiles(MakeSculpture(8000), 2);
  const std::vector<TileTriangle>& tile = tiles.tiles[0];
  SurfaceDecimator decimator;
  const auto n = static_cast<uint32_t>(tile.size());
  const TileResult all = decimator.Decimate(tile, tiles.grid, To(n / 4));
  const auto run = [&](double level, uint32_t level_triangles) {
    DecimateOptions options = To(n / 4);
    options.level_error = level;
    options.level_triangles = level_triangles;
    const TileResult r = decimator.Decimate(tile, tiles.grid, options);
    // The same removals, but fewer.
    REQUIRE(r.removals.size() <= all.removals.size());
    for (size_t i = 0; i < r.removals.size(); ++i) {
      REQUIRE(r.removals[i].vertex == all.removals[i].vertex);
    }
    return r;
  };
  const double level = all.removals[all.removals.size() * 2 / 3].error;
  const TileResult stopped = run(level, n);
  REQUIRE(stopped.removals.size() < all.removals.size());
  REQUIRE(stopped.removals.size() > 100);
  for (const Removal& removal : stopped.removals) REQUIRE(removal.error <= level);
  REQUIRE(all.removals[stopped.removals.size()].error > level);
  // A level of nothing waits until few enough are left; a large one never stops.
  const TileResult half = run(0, n / 2);
  const size_t left = Current(half, n, half.removals.size()).size();
  REQUIRE(left <= n / 2);
  REQUIRE(left + 2 >= n / 2);
  REQUIRE(run(1e9, n).removals.size() == all.removals.size());
}

// Guesses nothing of diagonals, whose errors are as good as random; finds out whether a filling is
// the best of all, whose errors are these.
class HiddenErrors : public MeasureDefaults {
 public:
  static constexpr ErrorMeasure kMeasure = ErrorMeasure::kTwoSidedDistance;

  void Begin(const TileMesh& mesh, std::span<const TileTriangle>, const Grid&,
             const MeasureOptions&) {
    errors_.assign(mesh.triangles(), 0);
  }
  double FirstGuess(uint32_t) const { return 0; }
  void Open(Hole& hole) const {
    Vec3d normal{};
    for (uint32_t i = 0; i < hole.k; ++i) {
      normal += Cross(hole.positions[i] - hole.apex, hole.positions[(i + 1) % hole.k] - hole.apex);
    }
    hole.LookAlong(normal * (1 / Length(normal)), Length(normal));
  }
  bool Sees(const Hole& hole) const { return !hole.boundary; }
  bool PriceEdges(Hole& hole) {
    hole.ForEachDiagonal([&](uint32_t i, uint32_t j) { hole.edge_error[i][j] = 0; });
    chosen_ = true;
    return false;
  }
  void MeasureEdges(Hole& hole, const Filling& filling, const Hole::PerEdge<bool>&) const {
    for (uint32_t t = 1; t < hole.k - 2; ++t) {
      MeasureEdge(hole, filling.triangles[t][0], filling.triangles[t][2]);
    }
  }
  void MeasureEdge(Hole& hole, uint32_t i, uint32_t j) const {
    const uint64_t random = Mix64(Mix64(hole.ring[i] ^ hole.ring[j]) + hole.vertex);
    hole.edge_error[i][j] = random % 10 == 0 ? -1 : 100.0 * static_cast<double>(random % 1000);
  }
  void Measure(const Hole& hole, Filling& filling) {
    filling.error = 1;
    filling.errors.fill(1);
    if (!std::exchange(chosen_, false)) return;  // an old filling, recalled
    Hole known = hole;
    known.ForEachDiagonal([&](uint32_t i, uint32_t j) { MeasureEdge(known, i, j); });
    FreeFilling rule;
    Hole::Triangles best;
    rule.Open(known);
    REQUIRE(rule.Fill(known, best));
    const auto cost = [&](const Hole::Triangles& triangles) {
      double sum = 0;
      for (uint32_t t = 1; t < hole.k - 2; ++t) {
        const double e = known.edge_error[triangles[t][0]][triangles[t][2]];
        REQUIRE(e >= 0);
        sum += e * e;
      }
      return sum;
    };
    REQUIRE(cost(filling.triangles) == Approx(cost(best)));
    ++measured;
  }
  void HandOn(const Hole& hole, const Filling&, uint32_t first) {
    errors_.resize(first + hole.k - 2, 1);
  }
  void End(TileResult& result) const { result.errors = errors_; }

  static inline int measured = 0;

 private:
  bool chosen_ = false;
  std::vector<float> errors_;
};

TEST_CASE("The best filling is found though errors of diagonals are only found when asked for") {
  const Tiles tiles = MakeTiles(MakeSculpture(1500), 1);
  Decimator<HiddenErrors, FreeFilling> decimator;
  decimator.Decimate(tiles.tiles[0], tiles.grid,
                     To(static_cast<uint32_t>(tiles.tiles[0].size() / 2)));
  REQUIRE(HiddenErrors::measured > 200);
}

TEST_CASE("A decimator that was used before gives what a new one gives") {
  const Tiles tiles = MakeTiles(MakeTerrain(4000), 4);
  SurfaceDecimator used;
  for (const std::vector<TileTriangle>& tile : tiles.tiles) {
    const DecimateOptions options = To(static_cast<uint32_t>(tile.size() / 4));
    const TileResult a = used.Decimate(tile, tiles.grid, options);
    const TileResult b = SurfaceDecimator().Decimate(tile, tiles.grid, options);
    REQUIRE(a.triangles == b.triangles);
    REQUIRE(a.errors == b.errors);
    REQUIRE(a.holes == b.holes);
    REQUIRE(a.stars == b.stars);
  }
}

TEST_CASE("A vertex of more neighbours than the limit is counted and stays") {
  TriangleMesh cone;
  for (const NastyMesh& nasty : NastyMeshes()) {
    if (nasty.name == "a cone of 3,000 triangles") cone = nasty.mesh;
  }
  REQUIRE(!cone.triangles.empty());
  Tiles tiles = MakeTiles(cone, 1);
  const TileResult some = SurfaceDecimator().Decimate(tiles.tiles[0], tiles.grid, To(2900));
  REQUIRE(some.removals.size() == 100);
  DecimateOptions options = To(0);
  options.largest_error = some.removals.back().error;
  const TileResult r = SurfaceDecimator().Decimate(tiles.tiles[0], tiles.grid, options);
  REQUIRE(r.stuck_degree == 1);
  REQUIRE(r.removals.size() >= 100);
  for (const Removal& removal : r.removals) REQUIRE((removal.fans == 1));
}

TEST_CASE("A tile of any size leaves a cluster that is not too large") {
  const Tiles tiles = MakeTiles(MakeSculpture(80'000), 2);
  size_t most = 0;
  for (const std::vector<TileTriangle>& tile : tiles.tiles) {
    REQUIRE(tile.size() > 2 * kMostTileTriangles);
    const TileResult r = SurfaceDecimator().Decimate(tile, tiles.grid, To(0));
    most = std::max(most, r.triangles.size() + r.removals.size());
    size_t rings = 0;
    for (const Removal& removal : r.removals) rings += removal.star_count + (removal.fans == 1);
    REQUIRE(r.triangles.size() <= kMostSlots);
    REQUIRE(rings <= kMostSlots);
    REQUIRE(r.removals.size() <= kMostNodes);
  }
  REQUIRE(most > kMostSlots - 100);  // or the limit was not met
}

}  // namespace mtdb::testing
