// SPDX-License-Identifier: Apache-2.0
#include "builder/rounds/round.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "builder/disk/ordered_pipeline.h"
#include "builder/tiles/tile_cutter.h"

namespace mtdb::internal {

namespace {

// A tile on its way.
struct Tile {
  TileJob job;            // until it is done
  bool replayed = false;  // the outcome comes from the journal
  Status status;
  TileOutcome outcome;
  std::vector<uint64_t> codes;  // of the outcome's triangles, on the next round's curve
};

// While a round's runs are merged, the next round's records gather in the other half.
std::unique_ptr<TriangleSorter> MakeSorter(const RoundTools& tools) {
  return std::make_unique<TriangleSorter>(
      TriangleSorter::Options{&tools.build.space, tools.plan.spool_bytes / 8 * 3,
                              tools.setting.row_bytes(), tools.plan.threads});
}

// The next tile, as the journal or the cutter has it. `alone`: it is the round's only one.
Result<Tile> NextTile(const RoundTools& tools, const RoundInput& input, bool alone,
                      TileCutter& cutter) {
  Tile tile;
  if (tools.journal != nullptr) {
    MTDB_ASSIGN_OR_RETURN(std::optional<TileOutcome> known, tools.journal->Next());
    tile.replayed = known.has_value();
    if (known) tile.outcome = *std::move(known);
  }
  TileJob& job = tile.job;
  job.setting = &tools.setting;
  job.round = input.round;
  MTDB_RETURN_IF_ERROR(cutter.Next(tile.replayed ? nullptr : &job.tile, &job.hilbert));
  job.limits = input.level.Limits(job.tile.triangles.size(), alone);
  return tile;
}

Status Work(const SurfaceWindow& surfaces, TileDecimator& decimator, Tile& tile) {
  MTDB_RETURN_IF_ERROR(PrepareTile(surfaces, tile.job));
  tile.outcome = DoTile(tile.job, decimator);
  tile.job = {};
  return Status::Ok();
}

// Writes the tile's cluster, and hands on what the tile leaves.
Status Append(const RoundTools& tools, Tile& tile, RoundResult& result) {
  const TileOutcome& outcome = tile.outcome;
  TileCluster& cluster = tile.outcome.cluster;
  RoundReport& report = result.report;
  report.locked_vertices += outcome.locked_vertices;
  report.stuck_topology += outcome.stuck_topology;
  report.stuck_degree += outcome.stuck_degree;
  result.seam_vertices += outcome.seam_vertices;
  result.vanished.components += outcome.vanished_components;
  result.vanished.border_loops += outcome.vanished_border_loops;
  uint32_t own = kNone32;
  if (!cluster.empty) {
    MTDB_ASSIGN_OR_RETURN(
        own, tools.writer.Add(cluster.entry, cluster.encoded.children, cluster.encoded.payload));
    if (!cluster.surface.empty()) MTDB_RETURN_IF_ERROR(result.surfaces->Add(own, cluster.surface));
    ++report.clusters;
    report.nodes += cluster.entry.nodes;
    report.error_code_max = std::max(report.error_code_max, cluster.entry.error_code_max);
    result.depth = std::max(result.depth, cluster.height);
    result.max_degree = std::max(result.max_degree, cluster.max_degree);
  }
  for (TileTriangle& t : cluster.left.triangles) {
    if (t.child == TileCluster::kOwnCluster) t.child = own;
  }
  tools.build.up.Add(cluster.left.triangles);
  return result.triangles->Add(cluster.left, tile.codes);
}

}  // namespace

Result<RoundResult> RunRound(const RoundTools& tools, const RoundInput& input) {
  const BuildContext& build = tools.build;
  MTDB_RETURN_IF_ERROR(input.triangles.Finish());
  const uint64_t count = input.triangles.count();
  const uint64_t size = build.options.tile_triangles;
  const uint64_t tiles = std::max<uint64_t>(1, (count + size / 2) / size);
  RoundResult result;
  result.report.triangles_in = count;
  result.report.tiles = tiles;
  result.triangles = MakeSorter(tools);
  result.surfaces = std::make_unique<SurfaceSpool>(
      input.round, &build.space, tools.plan.spool_bytes / (4 * SurfaceWindow::kMostRounds));
  TileCutter cutter(
      input.triangles, input.curve, tools.curves.grid,
      {tiles, input.round, size, tools.setting.row_bytes(), IsTerrain(build.options)});
  OrderedPipeline<Tile> pipeline(tools.plan.threads, [&](unsigned worker, Tile& tile) {
    if (!tile.replayed) tile.status = Work(input.surfaces, *tools.decimators[worker], tile);
    tile.codes = input.next_curve.Codes(tile.outcome.cluster.left.triangles, tools.curves.grid);
  });
  uint64_t given = 0;
  for (uint64_t taken = 0; taken < tiles; ++taken) {
    for (; given < tiles && pipeline.in_flight() < tools.plan.ahead; ++given) {
      MTDB_ASSIGN_OR_RETURN(Tile next, NextTile(tools, input, tiles == 1, cutter));
      pipeline.Submit(std::move(next));
    }
    Tile tile = pipeline.Take();
    MTDB_RETURN_IF_ERROR(tile.status);
    if (tools.journal != nullptr && !tile.replayed) {
      MTDB_RETURN_IF_ERROR(tools.journal->Append(tile.outcome));
    }
    MTDB_RETURN_IF_ERROR(Append(tools, tile, result));
    if ((taken & 15) != 15 && taken + 1 != tiles) continue;
    const uint64_t done = TileRange(count, tiles, taken).second;
    const double part = static_cast<double>(done) / static_cast<double>(count);
    MTDB_RETURN_IF_ERROR(
        build.clock.Report({"round", input.round, done, count, input.done + input.share * part}));
  }
  build.up.End(false);
  MTDB_RETURN_IF_ERROR(result.surfaces->Finish());
  result.report.triangles_out = result.triangles->count();
  return result;
}

Result<std::unique_ptr<TriangleSorter>> SortAnew(const RoundTools& tools, TriangleSorter& from,
                                                 const RoundCurve& curve, BuildProgress progress) {
  MTDB_RETURN_IF_ERROR(from.Finish());
  std::unique_ptr<TriangleSorter> anew = MakeSorter(tools);
  progress.triangles_total = from.count();
  while (progress.triangles_done < from.count()) {
    const uint64_t count = std::min<uint64_t>(tools.build.options.tile_triangles,
                                              from.count() - progress.triangles_done);
    TriangleBlock block;
    uint64_t unused = 0;
    MTDB_RETURN_IF_ERROR(from.Next(count, &block, &unused));
    MTDB_RETURN_IF_ERROR(anew->Add(block, curve.Codes(block.triangles, tools.curves.grid)));
    progress.triangles_done += count;
    MTDB_RETURN_IF_ERROR(tools.build.clock.Report(progress));
  }
  return anew;
}

}  // namespace mtdb::internal
