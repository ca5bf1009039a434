// SPDX-License-Identifier: Apache-2.0
// What one region costs a process that starts from nothing, in mtdb and as the naive user does it.
//
//   extract_bench boxes MESH --share S... [--json FILE]
//   extract_bench store STORE --query JSON [--cache-mb N] [--repeat N] [--json FILE]
//   extract_bench naive MESH [--box X0,Y0,Z0,X1,Y1,Z1 | --error E] [--repeat N] [--samples N]
//                     [--json FILE]
//
// boxes: cubes around one vertex of the mesh that meet the given shares of its triangles, and a
//   place outside in front of it: what the other two are asked for.
// store: opens the store (its first object) and answers the query (docs/query.md) into a mesh in
//   memory: cold; then again and again from the same handle: warm.
// naive: reads the whole mesh into memory, then crops it to the box, or simplifies it by
//   meshopt_simplify to the error, or does nothing: cold; crops or simplifies again: warm. With
//   --samples it measures how far the simplified mesh is off.
//
// One query a process, so that the peak of the resident memory is the query's: of cold and of warm
// together. Bytes are those that the process read from the storage until the cold answer was there:
// none where the file is in the system's cache.
// Checks that answers have the triangles that the statistics say, and repeat exactly.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <fstream>
#include <iostream>
#include <limits>
#include <string>
#include <vector>

#include "bench/internal/hausdorff.h"
#include "bench/internal/meshopt_simplify.h"
#include "bench/internal/workload.h"
#include "codecs/mesh_file/mesh_file.h"
#include "query/query_json.h"
#include "query/region.h"

namespace mtdb {
namespace {

struct Arguments {
  std::string input;
  std::vector<double> shares;
  std::string query = "{}";
  uint64_t cache_mb = 256;
  std::vector<double> box;
  double error = 0;
  uint64_t samples = 0;
  int repeat = 5;
  std::string json;
};

// Bytes that the process had read from the storage so far; 0 where the system does not tell.
uint64_t StorageBytes() {
  std::ifstream io("/proc/self/io");
  for (std::string line; std::getline(io, line);) {
    if (line.starts_with("read_bytes:")) return std::stoull(line.substr(11));
  }
  return 0;
}

struct Stopwatch {
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  double cpu_begin = ProcessCpuSeconds();
  double wall() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  }
  double cpu() const { return ProcessCpuSeconds() - cpu_begin; }
};

TriangleMesh Read(const std::string& path) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const Status status = ReadMeshFile(path, sink, nullptr);
  MTDB_CHECK(status.ok(), status.message().c_str());
  return mesh;
}

Triangle3d TriangleAt(const TriangleMesh& mesh, const TriangleVertices& t) {
  return {mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]};
}

Box3d Cube(Vec3d centre, double side) {
  const Vec3d half{0.5 * side, 0.5 * side, 0.5 * side};
  Box3d box;
  box.Add(centre - half);
  box.Add(centre + half);
  return box;
}

Json Boxes(const Arguments& arguments) {
  const TriangleMesh mesh = Read(arguments.input);
  Box3d bounds;
  for (const Vec3d& p : mesh.positions) bounds.Add(p);
  const Vec3d middle = (bounds.min + bounds.max) * 0.5;
  const double diagonal = Length(bounds.max - bounds.min);
  const Vec3d centre = mesh.positions[mesh.positions.size() / 3];
  const Vec3d out = centre - middle;
  const Vec3d eye = centre + out * (0.3 * diagonal / std::max(1e-9 * diagonal, Length(out)));
  Json rows = Json::array();
  for (const double share : arguments.shares) {
    double low = 0;
    double high = diagonal;
    uint64_t inside = 0;
    for (int i = 0; i < 16; ++i) {
      const double side = 0.5 * (low + high);
      const RegionPtr region = BoxRegion(Cube(centre, side));
      uint64_t meet = 0;
      for (const TriangleVertices& t : mesh.triangles) {
        meet += region->Within(TriangleAt(mesh, t), 0) ? 1 : 0;
      }
      if (static_cast<double>(meet) > share * static_cast<double>(mesh.triangles.size())) {
        high = side;
      } else {
        low = side;
        inside = meet;
      }
    }
    const Box3d box = Cube(centre, low);
    rows.push_back({{"share", share},
                    {"side", low},
                    {"diagonal", diagonal},
                    {"triangles", inside},
                    {"centre", {centre.x, centre.y, centre.z}},
                    {"eye", {eye.x, eye.y, eye.z}},
                    {"min", {box.min.x, box.min.y, box.min.z}},
                    {"max", {box.max.x, box.max.y, box.max.z}}});
  }
  return rows;
}

Json FromStore(const Arguments& arguments) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  Stopwatch cold;
  const auto database = Database::Open(arguments.input).value();
  const std::vector<ObjectRecord> objects = database->List().value();
  MTDB_CHECK(!objects.empty(), "the store has an object");
  const auto surface = Surface::Open(database->OpenObject(objects.front().name).value(),
                                     {.cache_bytes = arguments.cache_mb << 20})
                           .value();
  const double diagonal = surface->record().diagonal();
  const Result<Query> query = ParseQuery(arguments.query, diagonal);
  MTDB_CHECK(query.ok(), query.status().message().c_str());
  const ExtractStats stats = surface->Extract(*query, sink).value();
  const double cold_seconds = cold.wall();
  const double cold_cpu_seconds = cold.cpu();
  const uint64_t storage_bytes = StorageBytes();
  MTDB_CHECK(mesh.triangles.size() == stats.triangles, "the triangles are counted");
  double warm_seconds = std::numeric_limits<double>::max();
  double warm_cpu_seconds = warm_seconds;
  for (int i = 0; i < arguments.repeat; ++i) {
    const Stopwatch warm;
    const ExtractStats again = surface->Extract(*query, sink).value();
    warm_seconds = std::min(warm_seconds, warm.wall());
    warm_cpu_seconds = std::min(warm_cpu_seconds, warm.cpu());
    MTDB_CHECK(mesh.triangles.size() == stats.triangles && again.triangles == stats.triangles,
               "the same query has the same answer");
  }
  return Json::array({{{"method", "mtdb"},
                       {"triangles", stats.triangles},
                       {"active_triangles", stats.active_triangles},
                       {"object_triangles", surface->record().triangles},
                       {"error_rel", stats.error_bound / diagonal},
                       {"clusters_read", stats.clusters_read},
                       {"clusters_total", stats.clusters_total},
                       {"payload_bytes_read", stats.bytes_read},
                       {"storage_bytes_read", storage_bytes},
                       {"cache_bytes", arguments.cache_mb << 20},
                       {"cold_seconds", cold_seconds},
                       {"cold_cpu_seconds", cold_cpu_seconds},
                       {"warm_seconds", warm_seconds},
                       {"warm_cpu_seconds", warm_cpu_seconds},
                       {"peak_rss_bytes", PeakMemoryBytes()}}});
}

// The triangles that meet the box, with the vertices that they use.
TriangleMesh Crop(const TriangleMesh& mesh, const Box3d& box) {
  const RegionPtr region = BoxRegion(box);
  std::vector<VertexIndex> number(mesh.positions.size(), ~VertexIndex{0});
  TriangleMesh result;
  for (const TriangleVertices& t : mesh.triangles) {
    if (!region->Within(TriangleAt(mesh, t), 0)) continue;
    TriangleVertices& made = result.triangles.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      if (number[t[c]] == ~VertexIndex{0}) {
        number[t[c]] = result.positions.size();
        result.positions.push_back(mesh.positions[t[c]]);
      }
      made[c] = number[t[c]];
    }
  }
  return result;
}

Json Naive(const Arguments& arguments) {
  Stopwatch cold;
  const TriangleMesh mesh = Read(arguments.input);
  const double read_seconds = cold.wall();
  const auto answer = [&]() -> uint64_t {
    if (!arguments.box.empty()) {
      const std::vector<double>& b = arguments.box;
      Box3d box;
      box.Add(Vec3d{b[0], b[1], b[2]});
      box.Add(Vec3d{b[3], b[4], b[5]});
      return Crop(mesh, box).triangles.size();
    }
    if (arguments.error > 0) {
      return SimplifyByMeshoptToError(MeshoptInput(mesh), arguments.error).size() / 3;
    }
    return mesh.triangles.size();
  };
  const uint64_t triangles = answer();
  const double cold_seconds = cold.wall();
  const double cold_cpu_seconds = cold.cpu();
  const uint64_t storage_bytes = StorageBytes();
  double warm_seconds = std::numeric_limits<double>::max();
  double warm_cpu_seconds = warm_seconds;
  for (int i = 0; i < arguments.repeat; ++i) {
    const Stopwatch warm;
    MTDB_CHECK(answer() == triangles, "the same question has the same answer");
    warm_seconds = std::min(warm_seconds, warm.wall());
    warm_cpu_seconds = std::min(warm_cpu_seconds, warm.cpu());
  }
  const uint64_t peak_rss_bytes = PeakMemoryBytes();
  Json row = {{"method", "naive"},
              {"triangles", triangles},
              {"object_triangles", mesh.triangles.size()},
              {"storage_bytes_read", storage_bytes},
              {"read_seconds", read_seconds},
              {"cold_seconds", cold_seconds},
              {"cold_cpu_seconds", cold_cpu_seconds},
              {"warm_seconds", warm_seconds},
              {"warm_cpu_seconds", warm_cpu_seconds},
              {"peak_rss_bytes", peak_rss_bytes}};
  if (arguments.samples > 0) {
    const TriangleMesh simple =
        MeshOf(MeshoptInput(mesh), SimplifyByMeshoptToError(MeshoptInput(mesh), arguments.error));
    row["measured_error"] = SymmetricHausdorff(mesh, simple, arguments.samples);
  }
  return Json::array({row});
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Measures what one region costs a process that starts from nothing.");
  app.require_subcommand(1);
  CLI::App* boxes = app.add_subcommand("boxes", "Cubes with shares of a mesh's triangles");
  boxes->add_option("mesh", arguments.input)->required();
  boxes->add_option("--share", arguments.shares, "Shares, from 0 to 1")->required();
  CLI::App* store = app.add_subcommand("store", "A query, cold and warm");
  store->add_option("store", arguments.input)->required();
  store->add_option("--query", arguments.query, "JSON (docs/query.md)");
  store->add_option("--cache-mb", arguments.cache_mb, "Budget of the cache of clusters in MiB");
  CLI::App* naive = app.add_subcommand("naive", "The whole mesh in memory, cropped or simplified");
  naive->add_option("mesh", arguments.input)->required();
  CLI::Option* box = naive->add_option("--box", arguments.box, "X0,Y0,Z0,X1,Y1,Z1");
  box->delimiter(',')->expected(6);
  CLI::Option* error = naive->add_option("--error", arguments.error, "In model units");
  error->excludes(box)->check(CLI::PositiveNumber);
  naive->add_option("--samples", arguments.samples, "Points on each surface")->needs(error);
  for (CLI::App* verb : {store, naive}) {
    verb->add_option("--repeat", arguments.repeat, "Warm runs; the best counts")
        ->check(CLI::PositiveNumber);
  }
  for (CLI::App* verb : {boxes, store, naive}) {
    verb->add_option("--json", arguments.json, "Write the rows to a file, not to standard output");
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& wrong) {
    return app.exit(wrong) == 0 ? 0 : 2;
  }
  const Json rows = boxes->parsed()   ? Boxes(arguments)
                    : store->parsed() ? FromStore(arguments)
                                      : Naive(arguments);
  if (arguments.json.empty()) {
    std::cout << rows.dump(2) << "\n";
    return 0;
  }
  return WriteRows(arguments.json, rows) ? 0 : 1;
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
