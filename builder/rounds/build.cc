// SPDX-License-Identifier: Apache-2.0
#include "builder/build.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <ctime>
#include <memory>
#include <optional>
#include <string>
#include <sys/statvfs.h>
#include <utility>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "builder/decimate/decimator.h"
#include "builder/decimate/up_finder.h"
#include "builder/disk/ordered_pipeline.h"
#include "builder/disk/triangle_sorter.h"
#include "builder/intake/corner_join.h"
#include "builder/intake/grid_choice.h"
#include "builder/intake/height_field.h"
#include "builder/intake/input_spool.h"
#include "builder/intake/looking_sink.h"
#include "builder/intake/memory_plan.h"
#include "builder/intake/read_mesh.h"
#include "builder/measure/tile_surface.h"
#include "builder/rounds/build_with.h"
#include "builder/tiles/round_level.h"
#include "builder/tiles/tile_cutter.h"
#include "builder/tiles/tiling.h"
#include "builder/tiles/tiling_choice.h"
#include "builder/write/journal.h"
#include "builder/write/root_writer.h"
#include "builder/write/tile_cluster.h"
#include "store/base/attribute_grid.h"
#include "store/base/hash.h"
#include "store/base/out_of_memory.h"
#include "store/base/surface_digest.h"
#include "store/metres_of_unit.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint32_t kMaxRounds = 250;  // a round's number is one byte
// A removal with a larger bound, as a fraction of the diagonal, is not worth a node: the mesh would
// not resemble the object any more, and the bound is loose there.
constexpr double kLargestError = 1.0 / 16;
// Rounds that are measured against one surface (docs/design.md, section 3): two, or, where it has
// no more triangles than a tile may have beneath it, as many as it takes to the root. A terrain's
// curves become too long for that.
constexpr uint32_t kWindow = 2;
constexpr uint32_t kTerrainWindow = 3;
constexpr uint32_t kMostWindow = 8;
constexpr uint64_t kTerrainVertexBytes = 3;  // about what a vertex takes in the store
// Shares of the whole work, for progress only.
constexpr double kReadShare = 0.04;
constexpr double kJoinShare = 0.12;

// Gives free pages back to the system, where the C library has a way.
void ReturnFreedMemory() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

class Builder {
 public:
  Builder(const DecimatorFactory& make_decimator, const BuildOptions& options, ObjectWriter& writer,
          const ProgressCallback& progress, BuildReport* report)
      : options_(options),
        writer_(writer),
        progress_(progress),
        report_(report),
        make_decimator_(make_decimator) {
    space_.directory = options.tmp_directory;
    space_.max_bytes = options.max_tmp_bytes;
  }

  Result<ObjectRecord> Run(const MeshProducer& input) {
    Result<ObjectRecord> published = Build(input);
    const StatusCode code = published.status().code();
    // The same build would fail again.
    const bool over =
        published.ok() || code == StatusCode::kBadInput || code == StatusCode::kInvalidArgument;
    if (journal_ != nullptr && over) {
      journal_->Remove();
      if (report_ != nullptr) report_->journal_left = false;
    }
    return published;
  }

 private:
  Result<ObjectRecord> Build(const MeshProducer& input) {
    std::unique_ptr<TriangleSorter> sorter;
    MTDB_RETURN_IF_ERROR(ReadInput(input, &sorter));
    const double total = static_cast<double>(record_.triangles);
    double done = kReadShare + kJoinShare;
    TilingChoice tiling(
        options_.tile_triangles *
        TileCutter::WindowTiles(options_.tile_triangles, record_.attributes.row_bytes()));
    for (uint32_t round = 1; round <= kMaxRounds; ++round) {
      const uint64_t before = sorter->count();
      // All rounds together take about reduction / (reduction - 1) times the first.
      done_before_ = std::min(0.98, done);
      share_ = std::min(0.98 - done_before_, (0.98 - kReadShare - kJoinShare) *
                                                 static_cast<double>(before) / total *
                                                 (options_.reduction - 1) / options_.reduction);
      const uint64_t vertices = record_.vertices - record_.nodes;
      MTDB_RETURN_IF_ERROR(RunRound(round, &sorter));
      done += share_;
      const TilingChoice::Round result{before, sorter->count(), vertices, seam_vertices_};
      const bool more = tiling.Next(result);
      level_->Next(sorter->count(), tiling.was_hindered());
      if (!more) break;
      if (tiling.owner_levels() == 0) continue;
      curve_.emplace(CurveOf(round + 1, tiling.owner_levels()));
      MTDB_RETURN_IF_ERROR(SortAnew(&sorter));
    }
    MTDB_RETURN_IF_ERROR(WriteRoot(*sorter));
    record_.units = options_.units;
    const Vec3d up = options_.up.value_or(is_terrain() ? Vec3d{0, 0, 1} : up_.Find(record_.grid));
    record_.up = {up * (1 / Length(up)), options_.up.has_value()};
    MTDB_RETURN_IF_ERROR(Report("publish", 0, 0, 0, 1));
    Result<ObjectRecord> published = writer_.Publish(record_, [&](const ObjectRecord& record) {
      return journal_ == nullptr ? Status::Ok() : journal_->Finish(record);
    });
    CountStage("publish", 0);
    return published;
  }

  struct TileJob {
    TriangleBlock tile;
    uint64_t code = 0;
    bool alone = false;  // it is the round's only tile
    TileOutcome outcome;
    Status status;
    bool replayed = false;        // the outcome comes from the journal
    std::vector<uint64_t> codes;  // of the outcome's triangles, on the next round's curve
  };
  // A part of the joined input.
  struct JoinedBlock {
    TriangleBlock block;
    std::vector<uint64_t> codes;
    SurfaceDigest digest;
    Box3i bounds;
    uint64_t hash = 0;  // of all that later steps see of it
  };

  Status Report(const char* stage, uint32_t round, uint64_t done, uint64_t total, double overall) {
    CountStage(stage, round);
    if (!progress_) return Status::Ok();
    return progress_({stage, round, done, total, std::min(1.0, overall), space_.file_bytes});
  }

  // Adds the time since the last report to the stage that was reported then.
  void CountStage(const char* stage, uint32_t round) {
    const auto now = std::chrono::steady_clock::now();
    timespec cpu{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
    const double cpu_now =
        static_cast<double>(cpu.tv_sec) + 1e-9 * static_cast<double>(cpu.tv_nsec);
    if (!costs_.empty()) {
      costs_.back().seconds += std::chrono::duration<double>(now - stage_begin_).count();
      costs_.back().cpu_seconds += cpu_now - stage_begin_cpu_;
      costs_.back().tmp_bytes = std::max<uint64_t>(costs_.back().tmp_bytes, space_.file_bytes);
    }
    stage_begin_ = now;
    stage_begin_cpu_ = cpu_now;
    std::string name = stage;
    if (round != 0) name += " " + std::to_string(round);
    if (costs_.empty() || costs_.back().stage != name) costs_.push_back({name, 0, 0, 0});
    if (report_ != nullptr) report_->stages = costs_;
  }

  // In the journal, which counts among the temporary files.
  Status Record(const TileOutcome& outcome) {
    MTDB_RETURN_IF_ERROR(journal_->Append(outcome));
    MTDB_RETURN_IF_ERROR(space_.Take(journal_->bytes() - journal_bytes_));
    journal_bytes_ = journal_->bytes();
    return Status::Ok();
  }

  std::unique_ptr<TriangleSorter> MakeSorter(size_t memory_bytes) {
    return std::make_unique<TriangleSorter>(
        TriangleSorter::Options{&space_, memory_bytes, record_.attributes.row_bytes(), threads_});
  }
  // Blocks of joined triangles that are given to the pipeline ahead of the one that is taken.
  size_t blocks_ahead() const { return threads_ <= 1 ? 1 : 3 * static_cast<size_t>(threads_); }

  // Reads the mesh, classifies it, and leaves its triangles ready for round 1.
  Status ReadInput(const MeshProducer& produce, std::unique_ptr<TriangleSorter>* sorter) {
    MTDB_RETURN_IF_ERROR(Report("read", 0, 0, 0, 0));
    InputSpool input(&space_, 0, options_.mode == PositionMode::kLossless);
    MemoryPlan plan;
    const auto read = [&](MeshSink& sink) {
      LookingSink looking(&sink, [&] { return Report("read", 0, 0, 0, 0); });
      return produce(looking);
    };
    MTDB_ASSIGN_OR_RETURN(MeshSurvey survey, ReadMesh(read, options_, &input, &plan));
    threads_ = plan.threads;
    ahead_ = plan.ahead;
    memory_ = plan.spool_bytes;
    decimators_.resize(threads_);
    for (auto& decimator : decimators_) decimator = make_decimator_();
    MTDB_RETURN_IF_ERROR(Report("join", 0, 0, input.triangles(), kReadShare));
    MTDB_RETURN_IF_ERROR(CheckDisk(survey.temporary_bytes));
    if (options_.terrain) {
      survey.grid = options_.terrain->grid;
      const double most = std::max(options_.terrain->frame.columns, options_.terrain->frame.rows);
      survey.bits = static_cast<uint8_t>(std::ceil(std::log2(most + 1)));
      survey.store_bytes = survey.vertices * kTerrainVertexBytes;
    } else {
      MTDB_RETURN_IF_ERROR(ChooseGrid(input, options_, &space_, memory_ / 2, &survey));
      MTDB_RETURN_IF_ERROR(survey.refusal);
      if (options_.height_field) {
        MTDB_ASSIGN_OR_RETURN(steepest_,
                              MakeFacesLookUp(options_, &space_, memory_ / 2, &input, &survey));
        border_.emplace(memory_ / 4);
      }
    }
    ReturnFreedMemory();
    record_.grid = survey.grid;
    record_.bits = survey.bits;
    if (report_ != nullptr) report_->survey = std::move(survey);
    record_.attributes = input.header().attributes;
    record_.degree_limit = options_.degree_limit;
    record_.tile_triangles = options_.tile_triangles;
    record_.error_measure = decimators_.front()->measure();
    // The first round's curve needs bounds before the kept triangles' are known.
    const Grid& grid = input_grid();
    record_.bounds = {grid.Position(grid.Quantize(input.bounds().min)),
                      grid.Position(grid.Quantize(input.bounds().max))};
    if (options_.terrain) {
      record_.raster = options_.terrain->frame;
      record_.georeference = options_.terrain->crs;
    }
    if (is_terrain()) {
      // Heights and places have different units: tiles are cut along columns and rows.
      flat_bounds_ = record_.bounds;
      flat_bounds_.min.z = flat_bounds_.max.z = 0;
    }
    *sorter = MakeSorter(memory_ / 2);
    return JoinInput(input, **sorter);
  }

  bool looks_for_up() const { return !options_.up && !is_terrain(); }
  bool is_terrain() const { return options_.terrain.has_value() || options_.height_field; }

  // The grid on which the input's positions lie: a terrain's are the integers of the lattice.
  const Grid& input_grid() const { return options_.terrain ? lattice_ : record_.grid; }
  RoundCurve CurveOf(uint32_t round, uint32_t owner_levels = 0) const {
    return RoundCurve(is_terrain() ? flat_bounds_ : record_.bounds, round, owner_levels);
  }

  // Classifies the input's corners, gives its triangles to the sorter, and opens the journal.
  Status JoinInput(InputSpool& input, TriangleSorter& sorter) {
    const Grid& grid = input_grid();
    JoinTotals totals;
    SurfaceDigest digest;
    Box3i bounds;
    const RoundCurve& curve = curve_.emplace(CurveOf(1));
    OrderedPipeline<JoinedBlock> pipeline(threads_, [&](unsigned, JoinedBlock& joined) {
      joined.codes = curve.Codes(joined.block.triangles, grid);
      for (const TileTriangle& t : joined.block.triangles) {
        for (const Vec3i& p : t.positions) joined.bounds.Add(p);
        joined.digest.AddTriangle(t.positions);
      }
      joined.hash = Hash64(std::as_bytes(std::span(joined.block.triangles)));
      joined.hash = Hash64(std::as_bytes(std::span(joined.codes)), joined.hash);
      joined.hash = Hash64(joined.block.rows, joined.hash);
    });
    uint64_t joined_hash = 0;
    uint64_t taken = 0;
    const auto take = [&] {
      const JoinedBlock joined = pipeline.Take();
      digest.Merge(joined.digest);
      bounds.Add(joined.bounds);
      joined_hash = Mix64(joined_hash ^ joined.hash);
      if (looks_for_up()) up_.Add(joined.block.triangles);
      for (size_t i = 0; i < joined.codes.size(); ++i) {
        level_->Sample(joined.block.triangles[i], joined.codes[i]);
        if (border_) MTDB_RETURN_IF_ERROR(border_->Add(joined.block.triangles[i]));
      }
      MTDB_RETURN_IF_ERROR(AddAll(joined.block, joined.codes, sorter));
      const uint64_t before = std::exchange(taken, taken + joined.codes.size());
      if (before >> 20 == taken >> 20) return Status::Ok();
      const double part = static_cast<double>(taken) / static_cast<double>(input.triangles());
      return Report("join", 0, taken, input.triangles(),
                    kReadShare + kJoinShare * (0.5 + 0.5 * part));
    };
    // The sorter's half is free until the first triangle is received.
    const JoinOptions join{&space_, memory_ / 4, memory_ / 2, threads_};
    const auto receive = [&](TriangleBlock block) {
      if (!level_) {
        level_.emplace(input.triangles() - totals.duplicate_triangles, options_.reduction,
                       options_.degree_limit);
      }
      if (pipeline.in_flight() == blocks_ahead()) MTDB_RETURN_IF_ERROR(take());
      pipeline.Submit({std::move(block), {}, {}, {}, 0});
      return Status::Ok();
    };
    MTDB_RETURN_IF_ERROR(JoinCorners(input, grid, join, &totals, receive));
    while (pipeline.in_flight() > 0) MTDB_RETURN_IF_ERROR(take());
    up_.End(false);
    if (border_) {
      if (totals.nonmanifold_edges > 0) return OverlappingFaces(totals.nonmanifold_edges);
      MTDB_RETURN_IF_ERROR(border_->Check(record_.grid));
      border_.reset();
    }
    RecordInput(input, totals, digest, bounds);
    return OpenJournal(joined_hash);
  }

  void RecordInput(const InputSpool& input, const JoinTotals& totals, const SurfaceDigest& digest,
                   const Box3i& bounds) {
    const Grid& grid = record_.grid;
    record_.bounds = grid.Bounds(bounds);
    record_.double_positions = !grid.FitsFloat(record_.bounds);
    level_->Begin(*decimators_.front(), grid, LargestError(bounds));
    record_.input = input.report();
    record_.input.unreferenced_vertices = totals.unreferenced_vertices;
    record_.input.duplicate_triangles = totals.duplicate_triangles;
    record_.input.nonmanifold_edges = totals.nonmanifold_edges;
    record_.input.nonmanifold_vertices = totals.nonmanifold_vertices;
    record_.rounding_error = totals.rounding_error + input.rounding();
    // A vertex that moved aside changes heights by as much as the surface is steep.
    if (options_.height_field) record_.rounding_error *= std::hypot(1, steepest_);
    if (options_.terrain && options_.terrain->reading) {
      const TerrainInput::Reading reading = options_.terrain->reading();
      record_.rounding_error += reading.rounding;
      record_.raster->filled = reading.filled;
    }
    record_.vertices = totals.vertices;
    record_.triangles = totals.triangles;
    record_.boundary_edges = totals.boundary_edges;
    record_.surface_digest = digest.surface_digest();
    record_.border_digest = digest.border_digest();
  }

  // Work units. Of a terrain nothing is farther off than its heights are apart, but for borders
  // that move.
  double LargestError(const Box3i& bounds) {
    const double step = record_.grid.is_linear() ? record_.grid.step : 1.0;
    if (!is_terrain()) return kLargestError * record_.diagonal() / step;
    const double heights = static_cast<double>(bounds.max.z) - bounds.min.z + 1;
    if (!MoveBorders()) return heights;
    const Vec3d size = border_plane_->Place(ToDouble(bounds.max) - ToDouble(bounds.min));
    return std::max(heights, kLargestError * Length(size));
  }

  // Of a terrain whose outline is no rectangle. False: it is one.
  bool MoveBorders() {
    const bool ragged =
        options_.terrain && options_.terrain->reading && options_.terrain->reading().holes > 0;
    if (!ragged && !options_.height_field) return false;
    record_.border_moves = true;
    border_plane_.emplace();
    if (!options_.terrain) return true;
    const std::array<double, 2> metres = MetresOfUnit(record_);
    for (size_t i = 0; i < 4; ++i) {
      border_plane_->plane[i] = record_.grid.plane[i] * metres[i / 2] / record_.grid.step;
    }
    return true;
  }

  // `input`: the hash of the joined triangles.
  Status OpenJournal(uint64_t input) {
    if (options_.journal_path.empty()) return Status::Ok();
    ByteWriter o;
    o.Put(static_cast<uint8_t>(options_.mode));
    if (options_.mode == PositionMode::kGrid) {
      // A grid that was chosen is in the other hash, with all grids.
      o.Put<uint8_t>(options_.step ? 1 : options_.bits ? 0 : 2);
      o.Put(options_.step ? *options_.step : static_cast<double>(options_.bits.value_or(0)));
    }
    o.Put(options_.normal_bits.value_or(0));
    std::vector<AttributeStep> steps = options_.attribute_steps;
    std::ranges::sort(steps, {}, &AttributeStep::name);
    for (const AttributeStep& step : steps) {
      o.PutString(step.name);
      o.Put(step.step);
    }
    if (options_.terrain) o.Put(static_cast<uint8_t>(options_.terrain->triangulation));
    if (options_.height_field) o.PutString("height field");
    for (const uint32_t n : {options_.degree_limit, options_.tile_triangles, options_.reduction}) {
      o.Put(n);
    }
    ByteWriter w;
    w.Put(input);
    const Grid& grid = record_.grid;  // a moved or scaled mesh may have the same integers
    for (const double x : {grid.origin.x, grid.origin.y, grid.origin.z, grid.step, grid.error_unit,
                           record_.bounds.min.x, record_.bounds.min.y, record_.bounds.min.z,
                           record_.bounds.max.x, record_.bounds.max.y, record_.bounds.max.z}) {
      w.Put(x);
    }
    for (const double x : grid.plane) w.Put(x);
    for (const VertexAttribute& a : record_.attributes.attributes) {
      w.PutString(a.name);
      w.Put(static_cast<uint8_t>(a.type));
      w.Put(a.step);
      w.Put(a.normal_bits);
    }
    const JournalKey key{Hash64(o.bytes()), Hash64(w.bytes())};
    MTDB_ASSIGN_OR_RETURN(journal_, Journal::Open(options_.journal_path, key, options_.journal_note,
                                                  options_.resume));
    if (report_ != nullptr) report_->journal_left = true;
    return Status::Ok();
  }

  // What the temporary files will take at most, against what the file system has.
  Status CheckDisk(uint64_t need) const {
    if (need == 0) return Status::Ok();
    struct statvfs fs;
    if (statvfs(space_.directory.c_str(), &fs) != 0) {
      return IoError(space_.directory + ": " + std::strerror(errno) +
                     "; name a folder for temporary files with --tmp");
    }
    const uint64_t have = static_cast<uint64_t>(fs.f_bavail) * fs.f_frsize;
    if (need > have) {
      return Status(StatusCode::kNoSpace, space_.directory + ": temporary files need up to " +
                                              std::to_string(need >> 20) + " MiB, but only " +
                                              std::to_string(have >> 20) +
                                              " MiB are free; name another folder with "
                                              "--tmp, or allow more --memory");
    }
    return Status::Ok();
  }

  static Status AddAll(const TriangleBlock& block, std::span<const uint64_t> codes,
                       TriangleSorter& sorter) {
    const size_t rows = block.triangles.empty() ? 0 : block.rows.size() / block.triangles.size();
    for (size_t i = 0; i < block.triangles.size(); ++i) {
      MTDB_RETURN_IF_ERROR(sorter.Add(block.triangles[i], block.rows.data() + i * rows, codes[i]));
    }
    return Status::Ok();
  }

  // Whether no round after this one is measured against the surface that `begun` began with.
  bool IsLast(uint32_t round, uint32_t begun) const {
    uint32_t window = is_terrain() ? kTerrainWindow : kMostWindow;
    if (triangles_in_[begun - 1] > kMostSurface) window = kWindow;
    return round + 1 >= begun + window;
  }

  Status Decimate(unsigned worker, uint32_t round, TileJob& job) {
    DecimateOptions options = level_->Options(job.tile.triangles.size(), job.alone);
    options.border = border_plane_ ? &*border_plane_ : nullptr;
    TileSurface surface;
    MTDB_ASSIGN_OR_RETURN(surface, GatherSurface(beneath_, job.tile.triangles));
    if (IsWorthGoingOn(surface, is_terrain())) options.surface = &surface;
    const TileResult result =
        decimators_[worker]->Decimate(job.tile.triangles, record_.grid, options);
    TileOutcome& outcome = job.outcome;
    const uint32_t begun = options.surface != nullptr ? surface.round : round;
    outcome.cluster = MakeTileCluster(job.tile, result, record_.grid, record_.attributes,
                                      {IsLast(round, begun) ? 0 : begun, options.surface});
    outcome.cluster.entry.round = static_cast<uint8_t>(round);
    outcome.cluster.entry.hilbert = job.code;
    outcome.locked_vertices = result.locked_vertices;
    outcome.seam_vertices = result.seam_vertices;
    outcome.stuck_topology = result.stuck_topology;
    outcome.stuck_degree = result.stuck_degree;
    job.tile = TriangleBlock{};
    return Status::Ok();
  }

  // Takes the triangles of `*sorter`, leaves the next round's there.
  Status RunRound(uint32_t round, std::unique_ptr<TriangleSorter>* sorter) {
    TriangleSorter& from = **sorter;
    MTDB_RETURN_IF_ERROR(from.Finish());
    const uint64_t count = from.count();
    const uint64_t tiles =
        std::max<uint64_t>(1, (count + options_.tile_triangles / 2) / options_.tile_triangles);
    RoundReport report;
    seam_vertices_ = 0;
    report.triangles_in = count;
    report.tiles = tiles;
    // While this round's runs are merged, the next round's records gather in the other half.
    std::unique_ptr<TriangleSorter> next = MakeSorter(memory_ / 8 * 3);
    left_ = std::make_unique<SurfaceSpool>(round, &space_, memory_ / (4 * kMostWindow));
    triangles_in_.push_back(count);
    const RoundCurve this_curve = *curve_;
    TileCutter cutter(
        from, this_curve, input_grid(),
        {tiles, round, options_.tile_triangles, record_.attributes.row_bytes(), is_terrain()});
    const RoundCurve curve = CurveOf(round + 1);
    OrderedPipeline<TileJob> pipeline(threads_, [&](unsigned worker, TileJob& job) {
      if (!job.replayed) job.status = Decimate(worker, round, job);
      job.codes = curve.Codes(job.outcome.cluster.left.triangles, input_grid());
    });
    uint64_t given = 0;
    for (uint64_t taken = 0; taken < tiles; ++taken) {
      while (given < tiles && pipeline.in_flight() < ahead_) {
        TileJob job;
        job.alone = tiles == 1;
        if (journal_ != nullptr) {
          MTDB_ASSIGN_OR_RETURN(std::optional<TileOutcome> known, journal_->Next());
          job.replayed = known.has_value();
          if (known) job.outcome = *std::move(known);
        }
        MTDB_RETURN_IF_ERROR(cutter.Next(job.replayed ? nullptr : &job.tile, &job.code));
        pipeline.Submit(std::move(job));
        ++given;
      }
      TileJob job = pipeline.Take();
      MTDB_RETURN_IF_ERROR(job.status);
      if (journal_ != nullptr && !job.replayed) MTDB_RETURN_IF_ERROR(Record(job.outcome));
      MTDB_RETURN_IF_ERROR(Append(job, report, *next));
      if ((taken & 15) == 15 || taken + 1 == tiles) {
        const uint64_t done = TileRange(count, tiles, taken).second;
        MTDB_RETURN_IF_ERROR(
            Report("round", round, done, count,
                   done_before_ + share_ * static_cast<double>(done) / static_cast<double>(count)));
      }
    }
    *sorter = std::move(next);
    up_.End(false);
    curve_.emplace(curve);
    MTDB_RETURN_IF_ERROR(left_->Finish());
    beneath_.push_back(std::move(left_));
    if (IsLast(round, beneath_.front()->round())) beneath_.erase(beneath_.begin());
    ReturnFreedMemory();
    report.triangles_out = (*sorter)->count();
    record_.rounds.push_back(report);
    return Status::Ok();
  }

  // Sorts the mesh once more, along curve_.
  Status SortAnew(std::unique_ptr<TriangleSorter>* sorter) {
    TriangleSorter& from = **sorter;
    MTDB_RETURN_IF_ERROR(from.Finish());
    std::unique_ptr<TriangleSorter> anew = MakeSorter(memory_ / 8 * 3);
    for (uint64_t done = 0; done < from.count();) {
      const uint64_t count = std::min<uint64_t>(options_.tile_triangles, from.count() - done);
      TriangleBlock block;
      uint64_t unused = 0;
      MTDB_RETURN_IF_ERROR(from.Next(count, &block, &unused));
      MTDB_RETURN_IF_ERROR(AddAll(block, curve_->Codes(block.triangles, input_grid()), *anew));
      done += count;
      MTDB_RETURN_IF_ERROR(Report("round", static_cast<uint32_t>(record_.rounds.size()), done,
                                  from.count(), done_before_ + share_));
    }
    *sorter = std::move(anew);
    return Status::Ok();
  }

  Status Append(TileJob& job, RoundReport& report, TriangleSorter& next) {
    const TileOutcome& outcome = job.outcome;
    TileCluster& cluster = job.outcome.cluster;
    report.locked_vertices += outcome.locked_vertices;
    seam_vertices_ += outcome.seam_vertices;
    report.stuck_topology += outcome.stuck_topology;
    report.stuck_degree += outcome.stuck_degree;
    uint32_t own = kNone32;
    if (!cluster.empty) {
      MTDB_ASSIGN_OR_RETURN(const UnitId id, writer_.Add(cluster.entry, cluster.encoded.children,
                                                         cluster.encoded.payload));
      own = id;
      if (!cluster.surface.empty()) {
        MTDB_RETURN_IF_ERROR(left_->Add(id, cluster.surface));
      }
      ++report.clusters;
      report.nodes += cluster.entry.nodes;
      report.error_code_max = std::max(report.error_code_max, cluster.entry.error_code_max);
      ++record_.clusters;
      record_.nodes += cluster.entry.nodes;
      record_.error_code_max = std::max(record_.error_code_max, cluster.entry.error_code_max);
      record_.depth = std::max(record_.depth, cluster.height);
      record_.max_degree = std::max(record_.max_degree, cluster.max_degree);
    }
    for (TileTriangle& t : cluster.left.triangles) {
      if (t.child == TileCluster::kOwnCluster) t.child = own;
    }
    if (looks_for_up()) up_.Add(cluster.left.triangles);
    return AddAll(cluster.left, job.codes, next);
  }

  Status WriteRoot(TriangleSorter& sorter) {
    MTDB_RETURN_IF_ERROR(Report("root", 0, 0, sorter.count(), 0.98));
    // The sorter has the other half. No tile is at work any more.
    const uint64_t allowed = memory_ / 2 + (uint64_t{16} << 20);
    const auto check = [&](uint64_t needed) {
      if (needed <= allowed) return Status::Ok();
      return Status(
          StatusCode::kBudgetExceeded,
          "the mesh cannot be simplified below " + std::to_string(sorter.count()) +
              " triangles (non-manifold places, or many small components); its root needs more "
              "than " +
              std::to_string(needed >> 20) + " MiB, of which " + std::to_string(allowed >> 20) +
              " are left for it; allow more --memory");
    };
    MTDB_RETURN_IF_ERROR(check(sorter.count() * RootWriter::kTriangleBytes));
    MTDB_RETURN_IF_ERROR(sorter.Finish());
    RootWriter root(record_.attributes, sorter.count(), writer_);
    const uint64_t most = RootWriter::PieceTriangles(record_.attributes.row_bytes());
    for (uint64_t done = 0; done < sorter.count();) {
      const uint64_t count = std::min(most, sorter.count() - done);
      TriangleBlock piece;
      uint64_t code = 0;
      MTDB_RETURN_IF_ERROR(sorter.Next(count, &piece, &code));
      MTDB_RETURN_IF_ERROR(root.AddPiece(piece.triangles, piece.rows));
      if (looks_for_up()) up_.Add(piece.triangles);
      MTDB_RETURN_IF_ERROR(check(root.memory_bytes()));
      done += count;
    }
    up_.End(true);
    const RootTopology topology = root.Finish();
    record_.root_pieces = topology.pieces;
    record_.root_vertices = topology.vertices;
    record_.root_triangles = topology.triangles;
    record_.components = topology.components;
    record_.boundary_loops = topology.border_loops;
    record_.euler_characteristic = topology.euler_characteristic;
    return Status::Ok();
  }

  const BuildOptions& options_;
  ObjectWriter& writer_;
  const ProgressCallback& progress_;
  BuildReport* report_;
  std::vector<StageCost> costs_;
  std::chrono::steady_clock::time_point stage_begin_;
  double stage_begin_cpu_ = 0;
  SpoolSpace space_;
  std::unique_ptr<Journal> journal_;
  uint64_t journal_bytes_ = 0;  // counted among the temporary files
  unsigned threads_ = 1;
  size_t ahead_ = 1;     // tiles on their way at a time
  uint64_t memory_ = 0;  // for spools and sorters
  const DecimatorFactory& make_decimator_;
  std::vector<std::unique_ptr<TileDecimator>> decimators_;  // of the threads
  ObjectRecord record_;
  const Grid lattice_;
  Box3d flat_bounds_;  // of a terrain's lattice, without heights
  // Of a mesh that is a height field.
  double steepest_ = 0;
  std::optional<BorderSweep> border_;
  std::optional<BorderPlane> border_plane_;
  std::optional<RoundLevel> level_;
  UpFinder up_;
  std::optional<RoundCurve> curve_;  // of the round that comes
  uint64_t seam_vertices_ = 0;       // that only seams locked in the last round
  // What rounds before left, that later ones may go on from; what this one leaves.
  std::vector<std::unique_ptr<SurfaceSpool>> beneath_;
  std::unique_ptr<SurfaceSpool> left_;
  std::vector<uint64_t> triangles_in_;  // of the rounds so far
  double done_before_ = 0;
  double share_ = 0;
};

}  // namespace

Result<ObjectRecord> internal::BuildObjectWith(const DecimatorFactory& make_decimator,
                                               const MeshProducer& input,
                                               const BuildOptions& options, ObjectWriter& writer,
                                               const ProgressCallback& progress,
                                               BuildReport* report) {
  return CatchOutOfMemory(
      [&] { return Builder(make_decimator, options, writer, progress, report).Run(input); });
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
