// SPDX-License-Identifier: Apache-2.0
#include "tests/builder/rounds.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <utility>

#include "builder/decimate/decimator.h"
#include "builder/tiles/tiling.h"
#include "builder/write/tile_cluster.h"
#include "tests/builder/input_oracle.h"

namespace mtdb::testing {

using namespace internal;

namespace {
const SpoolSpace& Space() {
  static const SpoolSpace kSpace{std::filesystem::temp_directory_path().string()};
  return kSpace;
}
}  // namespace

Rounds::Rounds(const TriangleMesh& mesh, size_t tiles, float error) {
  for (const Vec3d& p : mesh.positions) bounds_.Add(p);
  grid.origin = bounds_.min;
  grid.step = Diagonal(bounds_) / 30000;
  before = ClassifiedTriangles(mesh, grid);
  for (TileTriangle& t : before) t.error = error;
  after = before;
  Run(tiles);
}

void Rounds::Run(size_t tiles, const std::function<bool(size_t)>& begins_afresh, bool over) {
  const auto round = static_cast<uint32_t>(surfaces.size() + 1);
  const RoundCurve curve(bounds_, round);
  std::stable_sort(after.begin(), after.end(), [&](const TileTriangle& a, const TileTriangle& b) {
    return curve.Code(a, grid) < curve.Code(b, grid);
  });
  SurfaceDecimator decimator;
  std::vector<TileTriangle> left;
  auto spool = std::make_unique<SurfaceSpool>(round, &Space(), 0);
  for (size_t i = 0; i < tiles; ++i) {
    const auto [begin, end] = TileRange(after.size(), tiles, i);
    TriangleBlock tile;
    tile.triangles.assign(after.begin() + static_cast<std::ptrdiff_t>(begin),
                          after.begin() + static_cast<std::ptrdiff_t>(end));
    const TileSurface surface = GatherSurface(surfaces, tile.triangles).value();
    DecimateOptions options;
    options.target_triangles = static_cast<uint32_t>(tile.triangles.size() / (round == 1 ? 4 : 2));
    options.largest_error = 1e9;
    const bool afresh = surface.empty() || (begins_afresh && begins_afresh(i));
    if (!afresh) options.surface = &surface;
    const TileResult result = decimator.Decimate(tile.triangles, grid, options);
    for (const Removal& r : result.removals) removed.push_back(result.vertices[r.vertex]);
    const uint32_t begun = afresh ? round : surface.round;
    TileCluster cluster =
        MakeTileCluster(tile, {}, result, grid, {}, {}, {over ? 0 : begun, options.surface});
    if (!cluster.empty) REQUIRE(spool->Add(next_, cluster.surface).ok());
    for (TileTriangle& t : cluster.left.triangles) {
      if (t.child == TileCluster::kOwnCluster) t.child = next_;
      left.push_back(t);
    }
    if (!cluster.empty) ++next_;
  }
  REQUIRE(spool->Finish().ok());
  surfaces.push_back(std::move(spool));
  after = std::move(left);
}

}  // namespace mtdb::testing
