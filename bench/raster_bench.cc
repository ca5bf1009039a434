// SPDX-License-Identifier: Apache-2.0
// A raster of heights as a terrain, beside its peers.
//
//   raster_bench RASTER [--crop N] [--error E]... [--json FILE]
//
// Of a raster without holes (.hgt, .asc, .dem), or of N x N samples in its middle, in a store of
// its own:
//   a row "build": bytes of the store, processor time of the build, and Draco's bytes and processor
//   time of the full mesh at levels 10 and 7, with 16 bits;
//   a row "wire" for each way in which the root becomes the full surface on the wire of a session
//   (at once, and by halving errors), with triangles computed by the client and with coded holes:
//   bits for each vertex that travels, and processor time of both ends, of the update of the
//   session too; a row "cut" for each error: triangles of mtdb's cut; its vertical error, measured
//   at all samples; triangles that meshopt_simplify needs for the same measured error (the least of
//   a bisection; samples that its border leaves are not counted), and a greedy insertion over
//   CGAL's Delaunay triangulation.
//
// Checks that no sample is farther from a cut than promised. Exits with 1 when one is.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "bench/internal/cropped_raster.h"
#include "bench/internal/draco_peer.h"
#include "bench/internal/greedy_insertion.h"
#include "bench/internal/meshopt_simplify.h"
#include "bench/internal/workload.h"
#include "codecs/stream/update_stream.h"
#include "query/session.h"
#include "query/threshold.h"
#include "tools/gdal/raster_input.h"

namespace mtdb {
namespace {

struct Terrain {
  Heights heights;
  // Of the first sample of the lowest row, and from sample to sample, in the mesh's coordinates.
  Vec3d origin;
  double step_x = 1, step_y = 1;
};

// Heights by the positions of the full mesh, one for each sample.
Terrain SamplesOf(const TriangleMesh& mesh, uint32_t columns, uint32_t rows) {
  Terrain t;
  Vec3d low = mesh.positions[0];
  Vec3d high = low;
  for (const Vec3d& p : mesh.positions) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), 0};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), 0};
  }
  t.origin = low;
  t.step_x = (high.x - low.x) / (columns - 1);
  t.step_y = (high.y - low.y) / (rows - 1);
  t.heights = {columns, rows, std::vector<double>(size_t{columns} * rows)};
  for (const Vec3d& p : mesh.positions) {
    const auto column = static_cast<size_t>(std::lround((p.x - low.x) / t.step_x));
    const auto row = static_cast<size_t>(std::lround((p.y - low.y) / t.step_y));
    t.heights.at[row * columns + column] = p.z;
  }
  return t;
}

// The largest height difference between the mesh and the samples that it covers.
double VerticalError(const TriangleMesh& mesh, const Terrain& terrain) {
  const Heights& h = terrain.heights;
  double worst = 0;
  for (const TriangleVertices& triangle : mesh.triangles) {
    Vec3d p[3];
    for (size_t i = 0; i < 3; ++i) {
      p[i] = mesh.positions[triangle[i]];
      p[i].x = (p[i].x - terrain.origin.x) / terrain.step_x;
      p[i].y = (p[i].y - terrain.origin.y) / terrain.step_y;
    }
    const auto turn = [](const Vec3d& a, const Vec3d& b, double x, double y) {
      return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
    };
    const double area = turn(p[0], p[1], p[2].x, p[2].y);
    if (area == 0) continue;
    const auto [left, right] = std::minmax({p[0].x, p[1].x, p[2].x});
    const auto [bottom, top] = std::minmax({p[0].y, p[1].y, p[2].y});
    for (double y = std::max(std::ceil(bottom - 1e-6), 0.0);
         y <= std::min(top + 1e-6, h.rows - 1.0); ++y) {
      for (double x = std::max(std::ceil(left - 1e-6), 0.0);
           x <= std::min(right + 1e-6, h.columns - 1.0); ++x) {
        const double a = turn(p[1], p[2], x, y) / area;
        const double b = turn(p[2], p[0], x, y) / area;
        const double c = turn(p[0], p[1], x, y) / area;
        if (a < -1e-6 || b < -1e-6 || c < -1e-6) continue;
        const double height = a * p[0].z + b * p[1].z + c * p[2].z;
        worst = std::max(worst, std::abs(height - h.height(std::lround(x), std::lround(y))));
      }
    }
  }
  return worst;
}

// By bisection: the error does not fall with every triangle, but nearly.
uint64_t TrianglesOfMeshopt(const TriangleMesh& mesh, const Terrain& terrain, double error) {
  uint64_t few = 0;
  uint64_t enough = mesh.triangles.size();
  while (enough - few > std::max<uint64_t>(enough / 50, 1)) {
    const uint64_t middle = few + (enough - few) / 2;
    const TriangleMesh simplified = MeshByMeshopt(mesh, middle);
    if (VerticalError(simplified, terrain) <= error) {
      enough = std::min<uint64_t>(middle, std::max<uint64_t>(simplified.triangles.size(), few + 1));
    } else {
      few = middle;
    }
  }
  return enough;
}

// From the root to the full surface, by these errors and then at none.
Result<Json> WireRow(const std::shared_ptr<Surface>& surface, const std::vector<double>& errors,
                     bool computed) {
  const ObjectRecord& record = surface->record();
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<Session> session, Session::Open(surface));
  MTDB_ASSIGN_OR_RETURN(const BaseMesh base, session->Base());
  UpdateEncoder encoder({record.grid, record.attributes, 0, computed}, base);
  UpdateDecoder decoder;
  MTDB_RETURN_IF_ERROR(decoder.Feed(encoder.start()));
  uint64_t bytes = 0;
  double update = 0;
  double encode = 0;
  double decode = 0;
  for (size_t i = 0; i <= errors.size(); ++i) {
    Query query;
    if (i < errors.size()) query.threshold = ConstantThreshold(errors[i]);
    std::vector<UpdateBatch> batches;
    const double begin = ProcessCpuSeconds();
    MTDB_RETURN_IF_ERROR(session->Update(query, &batches).status());
    const double updated = ProcessCpuSeconds();
    const Bytes sent = encoder.Encode(batches);
    const double encoded = ProcessCpuSeconds();
    MTDB_RETURN_IF_ERROR(decoder.Feed(sent));
    decode += ProcessCpuSeconds() - encoded;
    encode += encoded - updated;
    update += updated - begin;
    bytes += sent.size();
  }
  if (decoder.mesh().triangle_count() != record.triangles) {
    return Corrupt("the client has other triangles");
  }
  const uint64_t vertices = record.vertices - base.vertices.size();
  return Json{{"what", "wire"},
              {"triangles_by", computed ? "client" : "coded holes"},
              {"steps", errors.size() + 1},
              {"vertices", vertices},
              {"start_bytes", encoder.start().size()},
              {"bytes", bytes},
              {"bits_per_vertex", 8.0 * static_cast<double>(bytes) / static_cast<double>(vertices)},
              {"update_seconds", update},
              {"encode_seconds", encode},
              {"decode_seconds", decode}};
}

struct Arguments {
  std::string raster;
  uint32_t crop = 0;
  std::vector<double> errors;
  std::string json;
};

Json BuildRow(const TriangleMesh& mesh, const ObjectRecord& record, const BenchStore& store,
              double seconds) {
  Json row{{"what", "build"},
           {"samples", record.vertices},
           {"triangles", record.triangles},
           {"file_bytes", std::filesystem::file_size(store.path())},
           {"build_seconds", seconds}};
  for (const int level : {10, 7}) {
    const double begin = ProcessCpuSeconds();
    const DracoResult draco = MeasureDraco(mesh, 16, level);
    const double all = ProcessCpuSeconds() - begin;
    row["draco_level_" + std::to_string(level)] = {{"bytes", draco.bytes},
                                                   {"encode_seconds", all - draco.decode_seconds}};
  }
  return row;
}

Result<Json> Run(const Arguments& arguments) {
  std::vector<std::unique_ptr<RasterReader>> files;
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<RasterReader> file, OpenRaster(arguments.raster, 64 << 20));
  if (arguments.crop > 0) {
    file = std::make_unique<CroppedRaster>(std::move(file), arguments.crop);
  }
  const RasterFrame frame = file->info().frame;
  files.push_back(std::move(file));
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<RasterInput> input,
                        RasterInput::Join(std::move(files), {{}, 0, uint64_t{2} << 30}));
  TriangleMesh lattice;
  TriangleMeshSink sink(&lattice);
  MTDB_RETURN_IF_ERROR(input->Read(sink));
  if (input->report().holes > 0) return BadInput(arguments.raster + ": has holes");
  BenchStore store;
  BuildOptions options;
  options.terrain = input->terrain();
  const double begin = ProcessCpuSeconds();
  const ObjectRecord record = store.Build("terrain", lattice, options);
  const double seconds = ProcessCpuSeconds() - begin;
  const std::shared_ptr<Surface> surface = store.OpenSurface("terrain");
  ExtractStats stats;
  const TriangleMesh mesh = ExtractMesh(*surface, {}, &stats);
  const Terrain terrain = SamplesOf(mesh, frame.columns, frame.rows);
  Json rows = Json::array();
  rows.push_back(BuildRow(mesh, record, store, seconds));
  for (const bool computed : {true, false}) {
    for (const std::vector<double>& errors :
         {std::vector<double>{}, std::vector<double>{32, 16, 8, 4, 2}}) {
      MTDB_ASSIGN_OR_RETURN(const Json row, WireRow(surface, errors, computed));
      rows.push_back(row);
    }
  }
  for (const double error : arguments.errors) {
    Query query;
    query.threshold = ConstantThreshold(error);
    const TriangleMesh cut = ExtractMesh(*surface, query, &stats);
    const double measured = VerticalError(cut, terrain);
    if (measured > error * (1 + 1e-9)) {
      return BadInput("a sample is " + std::to_string(measured) + " from a cut at " +
                      std::to_string(error));
    }
    rows.push_back({{"what", "cut"},
                    {"error", error},
                    {"promised", stats.error_bound},
                    {"measured", measured},
                    {"triangles", cut.triangles.size()},
                    {"meshoptimizer", TrianglesOfMeshopt(mesh, terrain, measured)},
                    {"greedy", TrianglesOfGreedyInsertion(terrain.heights, measured)}});
  }
  return rows;
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Measures terrains of rasters beside peers.");
  app.add_option("raster", arguments.raster, "A raster without holes")->required();
  app.add_option("--crop", arguments.crop, "So many columns and rows in its middle")
      ->check(CLI::Range(2, 1 << 20));
  app.add_option("--error", arguments.errors, "Vertical errors of cuts");
  app.add_option("--json", arguments.json, "Write the rows to a file, not to standard output");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const Result<Json> rows = Run(arguments);
  if (!rows.ok()) {
    std::fprintf(stderr, "%s\n", rows.status().message().c_str());
    return 1;
  }
  if (!arguments.json.empty()) return WriteRows(arguments.json, *rows) ? 0 : 1;
  std::printf("%s\n", rows->dump(2).c_str());
  return 0;
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
