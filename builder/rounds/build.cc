// SPDX-License-Identifier: Apache-2.0
#include "builder/build.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "builder/decimate/up_finder.h"
#include "builder/rounds/build_context.h"
#include "builder/rounds/build_with.h"
#include "builder/rounds/intake.h"
#include "builder/rounds/round.h"
#include "builder/rounds/stage_clock.h"
#include "builder/rounds/surface_window.h"
#include "builder/tiles/tile_cutter.h"
#include "builder/tiles/tiling_choice.h"
#include "builder/write/journal.h"
#include "builder/write/root_writer.h"
#include "builder/write/texture_pages.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint32_t kMaxRounds = 250;  // a round's number is one byte

void AddRound(const RoundResult& round, ObjectRecord& record) {
  record.clusters += static_cast<uint32_t>(round.report.clusters);
  record.nodes += round.report.nodes;
  record.error_code_max = std::max(record.error_code_max, round.report.error_code_max);
  record.depth = std::max(record.depth, round.depth);
  record.max_degree = std::max(record.max_degree, round.max_degree);
  record.components += round.vanished.components;
  record.boundary_loops += round.vanished.border_loops;
  record.rounds.push_back(round.report);
}

struct RoundsResult {
  ObjectRecord record;                        // with all but the root
  std::unique_ptr<TriangleSorter> triangles;  // that the last round leaves
};

Result<RoundsResult> RunRounds(const RoundTools& tools, IntakeResult intake) {
  const BuildOptions& options = tools.build.options;
  RoundsResult result{std::move(intake.record), std::move(intake.triangles)};
  ObjectRecord& record = result.record;
  std::unique_ptr<TriangleSorter>& triangles = result.triangles;
  SurfaceWindow surfaces(IsTerrain(tools.build.options));
  TilingChoice tiling(options.tile_triangles *
                      TileCutter::WindowTiles(options.tile_triangles, tools.setting.row_bytes()));
  double done = kReadShare + kJoinShare;
  for (uint32_t round = 1; round <= kMaxRounds; ++round) {
    const uint64_t before = triangles->count();
    const uint64_t vertices = record.vertices - std::min(record.vertices, record.nodes);
    // All rounds together take about reduction / (reduction - 1) times the first.
    const double share = std::min(
        kRoundsEnd - done, (kRoundsEnd - kReadShare - kJoinShare) * static_cast<double>(before) /
                               static_cast<double>(record.triangles) * (options.reduction - 1) /
                               options.reduction);
    RoundCurve next_curve = tools.curves.Curve(round + 1);
    surfaces.Begin(before);
    MTDB_ASSIGN_OR_RETURN(
        RoundResult ran, RunRound(tools, {round, *triangles, intake.curve, next_curve, intake.level,
                                          surfaces, done, share}));
    AddRound(ran, record);
    triangles = std::move(ran.triangles);
    surfaces.End(std::move(ran.surfaces));
    ReturnFreedMemory();
    done += share;
    const bool more = tiling.Next({before, triangles->count(), vertices, ran.seam_vertices});
    intake.level.Next(triangles->count(), tiling.was_hindered());
    if (!more) break;
    if (tiling.owner_levels() != 0) {
      next_curve = tools.curves.Curve(round + 1, tiling.owner_levels());
      MTDB_ASSIGN_OR_RETURN(triangles,
                            SortAnew(tools, *triangles, next_curve, {"round", round, 0, 0, done}));
    }
    intake.curve = next_curve;
  }
  return result;
}

Result<RootTopology> WriteRoot(const RoundTools& tools, TriangleSorter& triangles) {
  const BuildContext& build = tools.build;
  const AttributeLayout& attributes = tools.setting.attributes;
  const uint64_t count = triangles.count();
  MTDB_RETURN_IF_ERROR(build.clock.Report({"root", 0, 0, count, kRoundsEnd}));
  // The sorter has the other half. No tile is at work any more.
  const uint64_t allowed = tools.plan.spool_bytes / 2 + (uint64_t{16} << 20);
  const auto check = [&](uint64_t needed) {
    if (needed <= allowed) return Status::Ok();
    return Status(StatusCode::kBudgetExceeded,
                  "the mesh cannot be simplified below " + std::to_string(count) +
                      " triangles (non-manifold places, or many small components); its root needs "
                      "more than " +
                      std::to_string(needed >> 20) + " MiB, of which " +
                      std::to_string(allowed >> 20) + " are left for it; allow more --memory");
  };
  MTDB_RETURN_IF_ERROR(check(count * RootWriter::kTriangleBytes));
  MTDB_RETURN_IF_ERROR(triangles.Finish());
  RootWriter root(attributes, tools.setting.texture, count, tools.writer);
  const uint64_t most = RootWriter::PieceTriangles(tools.setting.row_bytes());
  for (uint64_t done = 0; done < count;) {
    const uint64_t size = std::min(most, count - done);
    TriangleBlock piece;
    uint64_t code = 0;
    MTDB_RETURN_IF_ERROR(triangles.Next(size, &piece, &code));
    MTDB_RETURN_IF_ERROR(root.AddPiece(piece.triangles, piece.rows));
    build.up.Add(piece.triangles);
    MTDB_RETURN_IF_ERROR(check(root.memory_bytes()));
    done += size;
  }
  build.up.End(true);
  return root.Finish();
}

void AddRoot(const RootTopology& root, ObjectRecord& record) {
  record.root_pieces = root.pieces;
  record.root_vertices = root.vertices;
  record.root_triangles = root.triangles;
  record.components += root.components;
  record.boundary_loops += root.border_loops;
}

ObjectUp UpOf(const BuildContext& build, const Grid& grid) {
  const bool given = build.options.up.has_value();
  const Vec3d up = given ? *build.options.up : build.up.Find(grid);
  return {up * (1 / Length(up)), given};
}

Result<ObjectRecord> WriteObject(const RoundTools& tools, IntakeResult intake,
                                 std::vector<std::string>* texture_notes) {
  const BuildContext& build = tools.build;
  // First: the rounds may take hours, and the images be gone by then.
  if (intake.record.texture) {
    TileMaker tiles(&build.space, tools.plan.threads, [&] {
      return build.clock.Report({"texture", 0, 0, 0, kReadShare + kJoinShare});
    });
    MTDB_RETURN_IF_ERROR(AddTexturePages(intake.textures, tools.writer, tiles,
                                         &*intake.record.texture, texture_notes));
    build.clock.Count("texture");
    intake.textures.clear();
  }
  MTDB_ASSIGN_OR_RETURN(RoundsResult rounds, RunRounds(tools, std::move(intake)));
  MTDB_ASSIGN_OR_RETURN(const RootTopology root, WriteRoot(tools, *rounds.triangles));
  AddRoot(root, rounds.record);
  rounds.record.up = UpOf(build, rounds.record.grid);
  MTDB_RETURN_IF_ERROR(build.clock.Report({"publish", 0, 0, 0, 1}));
  Result<ObjectRecord> published =
      tools.writer.Publish(rounds.record, [&](const ObjectRecord& record) {
        return tools.journal == nullptr ? Status::Ok() : tools.journal->Finish(record);
      });
  build.clock.Count("publish");
  return published;
}

// Errors are measured in work units.
std::optional<TileTexture> TextureOf(const ObjectRecord& record) {
  if (!record.texture) return std::nullopt;
  const double unit = record.grid.is_linear() ? record.grid.step : 1.0;
  return TileTexture{record.texture->step, record.texture->scale / unit};
}

Result<ObjectRecord> Build(const DecimatorFactory& make_decimator, const MeshProducer& input,
                           const BuildContext& build, ObjectWriter& writer, BuildReport& report) {
  const BuildOptions& options = build.options;
  MTDB_ASSIGN_OR_RETURN(IntakeResult intake, TakeIn(input, build, *make_decimator()));
  report.survey = std::move(intake.survey);
  std::unique_ptr<Journal> journal;
  if (!options.journal_path.empty()) {
    MTDB_ASSIGN_OR_RETURN(journal, Journal::Open(options, intake.journal_key, &build.space));
    report.journal_left = true;
  }
  std::vector<std::unique_ptr<TileDecimator>> decimators(intake.plan.threads);
  for (auto& decimator : decimators) decimator = make_decimator();
  const TileSetting setting{intake.record.grid, intake.record.attributes, TextureOf(intake.record),
                            intake.border, IsTerrain(options)};
  const RoundTools tools{build,      intake.plan, setting,      intake.curves,
                         decimators, writer,      journal.get()};
  Result<ObjectRecord> published = WriteObject(tools, std::move(intake), &report.texture_notes);
  const StatusCode code = published.status().code();
  // The same build would fail again.
  const bool over =
      published.ok() || code == StatusCode::kBadInput || code == StatusCode::kInvalidArgument;
  if (journal != nullptr && over) {
    journal->Remove();
    report.journal_left = false;
  }
  return published;
}

}  // namespace

Result<ObjectRecord> internal::BuildObjectWith(const DecimatorFactory& make_decimator,
                                               const MeshProducer& input,
                                               const BuildOptions& options, ObjectWriter& writer,
                                               const ProgressCallback& progress,
                                               BuildReport* report) {
  return CatchOutOfMemory([&] {
    const SpoolSpace space{options.tmp_directory, options.max_tmp_bytes};
    BuildReport unread;
    BuildReport& filled = report != nullptr ? *report : unread;
    StageClock clock(progress, space, filled.stages);
    UpFinder up(!options.up && !IsTerrain(options));
    const BuildContext build{options, space, clock, up};
    return Build(make_decimator, input, build, writer, filled);
  });
}

Result<ObjectRecord> BuildObject(const MeshProducer& input, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress,
                                 BuildReport* report) {
  const auto make = [&]() -> std::unique_ptr<TileDecimator> {
    // The mesh's own triangles need not be Delaunay's.
    if (options.height_field) return std::make_unique<FreeTerrainDecimator>();
    if (!options.terrain) return std::make_unique<SurfaceDecimator>();
    if (options.terrain->triangulation == Triangulation::kFree) {
      return std::make_unique<FreeTerrainDecimator>();
    }
    return std::make_unique<TerrainDecimator>();
  };
  return BuildObjectWith(make, input, options, writer, progress, report);
}

Result<ObjectRecord> BuildObject(const TriangleMesh& mesh, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress) {
  return BuildObject([&](MeshSink& sink) { return SendMesh(mesh, sink); }, options, writer,
                     progress);
}

}  // namespace mtdb
