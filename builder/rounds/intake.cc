// SPDX-License-Identifier: Apache-2.0
#include "builder/rounds/intake.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "builder/disk/ordered_pipeline.h"
#include "builder/intake/grid_choice.h"
#include "builder/intake/input_spool.h"
#include "builder/intake/read_mesh.h"
#include "builder/surface/corner_join.h"
#include "builder/surface/height_field.h"
#include "builder/surface/orient_sheets.h"
#include "store/base/bytes.h"
#include "store/base/hash.h"
#include "store/base/surface_digest.h"
#include "store/metres_of_unit.h"

namespace mtdb::internal {

namespace {

// A removal with a larger bound, as a fraction of the diagonal, is not worth a node: the mesh would
// not resemble the object any more, and the bound is loose there.
constexpr double kLargestError = 1.0 / 16;
constexpr uint64_t kTerrainVertexBytes = 3;  // about what a vertex takes in the store

// A mesh that is on disk, and whose grid is known.
struct ReadResult {
  MeshSurvey survey;
  MemoryPlan plan;
  double steepest = 0;  // slope of a mesh that becomes a terrain
  CurveSpace curves;    // of the first round: of all vertices, used or not
};

void SetRasterGrid(const TerrainInput& terrain, MeshSurvey& survey) {
  survey.grid = terrain.grid;
  const double most = std::max(terrain.frame.columns, terrain.frame.rows);
  survey.bits = static_cast<uint8_t>(std::ceil(std::log2(most + 1)));
  survey.store_bytes = survey.vertices * kTerrainVertexBytes;
}

// Hands a mesh on and asks before each block whether to go on.
class LookingSink final : public MeshSink {
 public:
  // `sink` must outlive it. An error of `look` is the block's.
  LookingSink(MeshSink* sink, std::function<Status()> look) : sink_(sink), look_(std::move(look)) {}

  Status Begin(const MeshHeader& header) override { return sink_->Begin(header); }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan rows) override {
    MTDB_RETURN_IF_ERROR(look_());
    return sink_->AddVertices(positions, rows);
  }
  Status AddTriangles(std::span<const TriangleVertices> triangles) override {
    MTDB_RETURN_IF_ERROR(look_());
    return sink_->AddTriangles(triangles);
  }
  Status AddCorners(std::span<const TextureCorner> corners) override {
    return sink_->AddCorners(corners);
  }
  Status End() override { return sink_->End(); }
  bool joins_soup() const override { return sink_->joins_soup(); }
  uint64_t soup_bytes() const override { return sink_->soup_bytes(); }
  double LargestRounding(const MeshHeader& header) const override {
    return sink_->LargestRounding(header);
  }
  double rounding() const override { return sink_->rounding(); }

 private:
  MeshSink* sink_;
  std::function<Status()> look_;
};

Result<ReadResult> Read(const MeshProducer& produce, const BuildContext& build, InputSpool& input) {
  const BuildOptions& options = build.options;
  ReadResult read;
  const auto look = [&] { return build.clock.Report({"read"}); };
  const auto looked_at = [&](MeshSink& sink) {
    LookingSink looking(&sink, look);
    return produce(looking);
  };
  MTDB_RETURN_IF_ERROR(look());
  MTDB_ASSIGN_OR_RETURN(read.survey, ReadMesh(looked_at, options, &input, &read.plan));
  MTDB_RETURN_IF_ERROR(build.clock.Report({"join", 0, 0, input.triangles(), kReadShare}));
  MeshSurvey& survey = read.survey;
  MTDB_RETURN_IF_ERROR(build.space.CheckRoom(survey.temporary_bytes));
  const uint64_t memory = read.plan.spool_bytes / 2;
  if (options.terrain) {
    SetRasterGrid(*options.terrain, survey);
  } else {
    MTDB_RETURN_IF_ERROR(ChooseGrid(input, options, &build.space, memory, &survey));
    MTDB_RETURN_IF_ERROR(survey.refusal);
  }
  if (options.orient) {
    survey.oriented = true;
    MTDB_ASSIGN_OR_RETURN(survey.sheets, OrientSheets(&input, &build.space, memory));
    MTDB_RETURN_IF_ERROR(look());
  }
  if (options.height_field) {
    MTDB_ASSIGN_OR_RETURN(read.steepest,
                          MakeFacesLookUp(options, &build.space, memory, &input, &survey));
  }
  ReturnFreedMemory();
  if (!options.terrain) read.curves.grid = survey.grid;
  const Grid& grid = read.curves.grid;
  read.curves.bounds = {grid.Position(grid.Quantize(input.bounds().min)),
                        grid.Position(grid.Quantize(input.bounds().max))};
  if (IsTerrain(build.options)) read.curves.bounds.min.z = read.curves.bounds.max.z = 0;
  return read;
}

// A part of the joined input.
struct JoinedBlock {
  TriangleBlock block;
  std::vector<uint64_t> codes;
  SurfaceDigest digest;
  Box3i bounds;
  uint64_t hash = 0;  // of all that later steps see of it
};

void Examine(const RoundCurve& curve, const Grid& grid, JoinedBlock& joined) {
  joined.codes = curve.Codes(joined.block.triangles, grid);
  for (const TileTriangle& t : joined.block.triangles) {
    for (const Vec3i& p : t.positions) joined.bounds.Add(p);
    joined.digest.AddTriangle(t.positions);
    if (t.two_sided()) joined.digest.AddTriangle({t.positions[0], t.positions[2], t.positions[1]});
  }
  joined.hash = Hash64(std::as_bytes(std::span(joined.block.triangles)));
  joined.hash = Hash64(std::as_bytes(std::span(joined.codes)), joined.hash);
  joined.hash = Hash64(joined.block.rows, joined.hash);
}

// Triangles that are classified and sorted, and what is known of them.
struct JoinResult {
  JoinTotals totals;
  SurfaceDigest digest;
  Box3i bounds;
  uint64_t hash = 0;
  std::optional<RoundLevel> level;  // it has a sample of them
  std::unique_ptr<TriangleSorter> triangles;
};

Result<JoinResult> Join(const BuildContext& build, const ReadResult& read, const RoundCurve& curve,
                        InputMesh& input) {
  const BuildOptions& options = build.options;
  const MemoryPlan& plan = read.plan;
  JoinResult result;
  result.triangles = std::make_unique<TriangleSorter>(TriangleSorter::Options{
      &build.space, plan.spool_bytes / 2, CornerRowBytes(input), plan.threads});
  std::optional<BorderSweep> border;
  if (options.height_field) border.emplace(plan.spool_bytes / 4);
  OrderedPipeline<JoinedBlock> pipeline(plan.threads, [&](unsigned, JoinedBlock& joined) {
    Examine(curve, read.curves.grid, joined);
  });
  uint64_t taken = 0;
  const auto take = [&] {
    const JoinedBlock joined = pipeline.Take();
    const std::vector<TileTriangle>& triangles = joined.block.triangles;
    result.digest.Merge(joined.digest);
    result.bounds.Add(joined.bounds);
    result.hash = Mix64(result.hash ^ joined.hash);
    build.up.Add(triangles);
    for (size_t i = 0; i < triangles.size(); ++i) {
      result.level->Sample(triangles[i], joined.codes[i]);
      if (border) MTDB_RETURN_IF_ERROR(border->Add(triangles[i]));
    }
    MTDB_RETURN_IF_ERROR(result.triangles->Add(joined.block, joined.codes));
    const uint64_t before = std::exchange(taken, taken + triangles.size());
    if (before >> 20 == taken >> 20) return Status::Ok();
    const double part = static_cast<double>(taken) / static_cast<double>(input.triangles());
    return build.clock.Report(
        {"join", 0, taken, input.triangles(), kReadShare + kJoinShare * (0.5 + 0.5 * part)});
  };
  // The sorter's half is free until the first triangle is received.
  const JoinOptions join{&build.space, plan.spool_bytes / 4, plan.spool_bytes / 2, plan.threads,
                         options.orient};
  const size_t ahead = plan.threads <= 1 ? 1 : 3 * size_t{plan.threads};
  const auto receive = [&](TriangleBlock block) {
    if (!result.level) {
      result.level.emplace(
          input.triangles() - result.totals.duplicate_triangles - result.totals.two_sided_triangles,
          options.reduction, options.degree_limit);
    }
    if (pipeline.in_flight() == ahead) MTDB_RETURN_IF_ERROR(take());
    pipeline.Submit({std::move(block), {}, {}, {}, 0});
    return Status::Ok();
  };
  MTDB_RETURN_IF_ERROR(JoinCorners(input, read.curves.grid, join, &result.totals, receive));
  while (pipeline.in_flight() > 0) MTDB_RETURN_IF_ERROR(take());
  build.up.End(false);
  if (!border) return result;
  if (result.totals.nonmanifold_edges > 0) return OverlappingFaces(result.totals.nonmanifold_edges);
  MTDB_RETURN_IF_ERROR(border->Check(read.survey.grid));
  return result;
}

// A unit of u, v counts as what it is long on the surface, on average.
TextureRecord TextureOf(const InputMesh& input, const JoinTotals& totals) {
  TextureRecord texture;
  texture.step = input.header().texture_step;
  texture.rounding = input.corners().rounding();
  if (totals.texture_lengths > 0) texture.scale = totals.lengths / totals.texture_lengths;
  for (const Texture& page : input.header().textures) {
    texture.pages.push_back({page.name, page.media_type, page.width, page.height, 0, 0});
  }
  return texture;
}

ObjectRecord RecordOf(const BuildOptions& options, const ReadResult& read, const InputMesh& input,
                      const JoinResult& joined) {
  const JoinTotals& totals = joined.totals;
  ObjectRecord record;
  record.grid = read.survey.grid;
  record.bits = read.survey.bits;
  record.attributes = input.header().attributes;
  record.degree_limit = options.degree_limit;
  record.tile_triangles = options.tile_triangles;
  record.units = options.units;
  record.bounds = record.grid.Bounds(joined.bounds);
  record.double_positions = !record.grid.FitsFloat(record.bounds);
  record.input = input.report();
  record.input.unreferenced_vertices = totals.unreferenced_vertices;
  record.input.duplicate_triangles = totals.duplicate_triangles;
  record.input.two_sided_triangles = totals.two_sided_triangles;
  record.input.nonmanifold_edges = totals.nonmanifold_edges;
  record.input.nonmanifold_vertices = totals.nonmanifold_vertices;
  record.input.inconsistent_edges = totals.inconsistent_edges;
  record.input.unorientable_sheets = read.survey.sheets.unorientable_sheets;
  if (options.orient) record.input.turned_triangles = read.survey.sheets.turned_triangles;
  if (input.textured()) record.texture = TextureOf(input, totals);
  record.rounding_error = totals.rounding_error + input.rounding();
  if (record.texture) {
    record.rounding_error =
        std::max(record.rounding_error, record.texture->rounding * record.texture->scale);
  }
  // A vertex that moved aside changes heights by as much as the surface is steep.
  if (options.height_field) record.rounding_error *= std::hypot(1, read.steepest);
  if (options.terrain) {
    record.raster = options.terrain->frame;
    record.georeference = options.terrain->crs;
  }
  if (options.terrain && options.terrain->reading) {
    const TerrainInput::Reading reading = options.terrain->reading();
    record.rounding_error += reading.rounding;
    record.raster->filled = reading.filled;
    record.border_moves = reading.holes > 0;
  }
  if (options.height_field) record.border_moves = true;
  record.vertices = totals.vertices;
  record.triangles = totals.triangles;
  record.boundary_edges = totals.boundary_edges;
  record.euler_characteristic = static_cast<int64_t>(totals.vertices) -
                                static_cast<int64_t>(totals.edges) +
                                static_cast<int64_t>(totals.triangles - totals.two_sided_triangles);
  record.surface_digest = joined.digest.surface_digest();
  record.border_digest = joined.digest.border_digest();
  return record;
}

// Of a terrain whose outline is no rectangle.
std::optional<BorderPlane> BorderOf(const ObjectRecord& record) {
  if (!record.border_moves) return std::nullopt;
  BorderPlane border;
  if (!record.raster) return border;
  const std::array<double, 2> metres = MetresOfUnit(record);
  for (size_t i = 0; i < 4; ++i) {
    border.plane[i] = record.grid.plane[i] * metres[i / 2] / record.grid.step;
  }
  return border;
}

// Work units. Of a terrain nothing is farther off than its heights are apart, but for borders that
// move.
double LargestError(const ObjectRecord& record, const Box3i& bounds, const BuildContext& build,
                    const std::optional<BorderPlane>& border) {
  const double step = record.grid.is_linear() ? record.grid.step : 1.0;
  if (!IsTerrain(build.options)) return kLargestError * record.diagonal() / step;
  const double heights = static_cast<double>(bounds.max.z) - bounds.min.z + 1;
  if (!border) return heights;
  const Vec3d size = border->Place(ToDouble(bounds.max) - ToDouble(bounds.min));
  return std::max(heights, kLargestError * Length(size));
}

// Of those that shape the result. A grid that was chosen is among the grids, in the other hash.
uint64_t HashOf(const BuildOptions& options) {
  ByteWriter w;
  w.Put(static_cast<uint8_t>(options.mode));
  if (options.mode == PositionMode::kGrid) {
    w.Put<uint8_t>(options.step ? 1 : options.bits ? 0 : 2);
    w.Put(options.step ? *options.step : static_cast<double>(options.bits.value_or(0)));
  }
  w.Put(options.normal_bits.value_or(0));
  w.Put(options.texture_step.value_or(-1));
  w.Put(static_cast<uint8_t>(options.drop_texture));
  std::vector<AttributeStep> steps = options.attribute_steps;
  std::ranges::sort(steps, {}, &AttributeStep::name);
  for (const AttributeStep& step : steps) {
    w.PutString(step.name);
    w.Put(step.step);
  }
  if (options.terrain) w.Put(static_cast<uint8_t>(options.terrain->triangulation));
  if (options.height_field) w.PutString("height field");
  if (options.orient) w.PutString("orient");
  for (const uint32_t n : {options.degree_limit, options.tile_triangles, options.reduction}) {
    w.Put(n);
  }
  return Hash64(w.bytes());
}

// `input`: the hash of the joined triangles.
JournalKey JournalKeyOf(const BuildOptions& options, const ObjectRecord& record, uint64_t input) {
  ByteWriter w;
  w.Put(input);
  const Grid& grid = record.grid;  // a moved or scaled mesh may have the same integers
  for (const double x : {grid.origin.x, grid.origin.y, grid.origin.z, grid.step, grid.error_unit,
                         record.bounds.min.x, record.bounds.min.y, record.bounds.min.z,
                         record.bounds.max.x, record.bounds.max.y, record.bounds.max.z}) {
    w.Put(x);
  }
  for (const double x : grid.plane) w.Put(x);
  for (const VertexAttribute& a : record.attributes.attributes) {
    w.PutString(a.name);
    w.Put(static_cast<uint8_t>(a.type));
    w.Put(a.step);
    w.Put(a.normal_bits);
  }
  if (record.texture) w.Put(record.texture->step);
  return {HashOf(options), Hash64(w.bytes())};
}

}  // namespace

Result<IntakeResult> TakeIn(const MeshProducer& produce, const BuildContext& build,
                            TileDecimator& decimator) {
  InputSpool input(&build.space, 0, build.options.mode == PositionMode::kLossless);
  MTDB_ASSIGN_OR_RETURN(ReadResult read, Read(produce, build, input));
  const RoundCurve curve = read.curves.Curve(1);
  MTDB_ASSIGN_OR_RETURN(JoinResult joined, Join(build, read, curve, input));
  if (!build.options.orient) read.survey.sheets = joined.totals.sheets;
  ObjectRecord record = RecordOf(build.options, read, input, joined);
  record.error_measure = decimator.measure();
  const std::optional<BorderPlane> border = BorderOf(record);
  joined.level->Begin(decimator, record.grid, LargestError(record, joined.bounds, build, border));
  if (!IsTerrain(build.options)) read.curves.bounds = record.bounds;
  const JournalKey key = JournalKeyOf(build.options, record, joined.hash);
  return IntakeResult{std::move(read.survey),
                      read.plan,
                      std::move(record),
                      border,
                      read.curves,
                      curve,
                      *std::move(joined.level),
                      std::move(joined.triangles),
                      key,
                      input.header().textures};
}

}  // namespace mtdb::internal
