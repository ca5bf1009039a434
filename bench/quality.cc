// SPDX-License-Identifier: Apache-2.0
// How good mtdb's cuts are, measured outside of mtdb's own code by CGAL's AABB tree.
//
//   quality_bench [--samples N] [--threads N] [--bits N] [--ratio R]... [--measure-only]
//                 [--bounds] [--json FILE] MESH...
//
// Without --bounds, for each manifold mesh, at ratios of its triangles (0.1 and 0.01): the
// symmetric Hausdorff distance, relative to the diagonal, of mtdb's cut and, at the same number of
// triangles, of meshopt_simplify (subset placement, as mtdb's) and of CGAL's Garland-Heckbert
// (plane quadrics) and Lindstrom-Turk simplification (both with optimal placement). With --bounds,
// for thresholds growing by factors of 2 from two grid steps: the promised and the measured
// distance, and the share of nodes that were applied only as ancestors.
//
// Exits with 1 when a bound does not hold and, without --measure-only, when mtdb's cut is worse
// than meshopt_simplify anywhere.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "bench/internal/cgal_simplify.h"
#include "bench/internal/hausdorff.h"
#include "bench/internal/meshopt_simplify.h"
#include "bench/internal/workload.h"
#include "codecs/mesh_file/mesh_file.h"

namespace mtdb {

namespace {

struct Arguments {
  std::vector<std::string> meshes;
  uint64_t samples = 500000;
  unsigned threads = 0;
  int bits = 16;
  std::vector<double> ratios{0.1, 0.01};
  std::string json;  // a file
  bool bounds = false;
  bool measure_only = false;
};

class Bench {
 public:
  explicit Bench(const Arguments& arguments) : arguments_(arguments) {}

  // False when something is worse than it must be.
  bool Run(const std::string& path) {
    name_ = path.substr(path.rfind('/') + 1);
    mesh_ = TriangleMesh{};
    TriangleMeshSink sink(&mesh_);
    MeshReadReport report;
    if (const Status status = ReadMeshFile(path, sink, &report); !status.ok()) {
      std::fprintf(stderr, "%s\n", status.message().c_str());
      return false;
    }
    BenchStore store;
    BuildOptions options;
    options.threads = arguments_.threads;
    options.bits = arguments_.bits;
    const ObjectRecord record = store.Build("mesh", mesh_, options);
    const std::shared_ptr<Surface> surface = store.OpenSurface("mesh");
    const bool manifold =
        record.input.nonmanifold_edges == 0 && record.input.nonmanifold_vertices == 0;
    if (arguments_.bounds) return Bounds(*surface);
    if (manifold) return Quality(*surface);
    std::fprintf(stderr, "%s: not manifold, skipped\n", name_.c_str());
    return true;
  }

  const Json& rows() const { return rows_; }

 private:
  double Measure(const TriangleMesh& mesh) const {
    return SymmetricHausdorff(mesh_, mesh, arguments_.samples);
  }

  bool Quality(const Surface& surface) {
    bool good = true;
    const double diagonal = surface.record().diagonal();
    for (const double ratio : arguments_.ratios) {
      Query query;
      query.max_triangles =
          static_cast<uint64_t>(ratio * static_cast<double>(surface.record().triangles));
      ExtractStats stats;
      const TriangleMesh cut = ExtractMesh(surface, query, &stats);
      const double ours = Measure(cut) / diagonal;
      const auto print = [&](const char* method, uint64_t triangles, double distance) {
        rows_.push_back({{"mesh", name_},
                         {"ratio", ratio},
                         {"method", method},
                         {"triangles", triangles},
                         {"hausdorff_rel", distance},
                         {"to_mtdb", distance / ours}});
        if (!arguments_.json.empty()) return;
        std::printf("%-36s %6.2f %-16s %9llu %11.3e %8.2f\n", name_.c_str(), ratio, method,
                    static_cast<unsigned long long>(triangles), distance, distance / ours);
        std::fflush(stdout);
      };
      print("mtdb", stats.triangles, ours);
      if (!(ours * diagonal <= stats.error_bound)) {
        std::fprintf(stderr, "%s: %g measured, %g promised\n", name_.c_str(), ours * diagonal,
                     stats.error_bound);
        good = false;
      }
      const TriangleMesh meshopt = MeshByMeshopt(mesh_, stats.triangles);
      const double theirs = Measure(meshopt) / diagonal;
      print("meshopt", meshopt.triangles.size(), theirs);
      if (ours > theirs) {
        std::fprintf(stderr, "%s: worse than meshopt_simplify at %g\n", name_.c_str(), ratio);
        good = good && arguments_.measure_only;
      }
      for (const auto& [method, label] : {std::pair{CgalMethod::kGarlandHeckbert, "cgal_gh"},
                                          std::pair{CgalMethod::kLindstromTurk, "cgal_lt"}}) {
        const std::optional<TriangleMesh> peer = SimplifyByCgal(mesh_, stats.triangles, method);
        if (peer) print(label, peer->triangles.size(), Measure(*peer) / diagonal);
      }
    }
    return good;
  }

  bool Bounds(const Surface& surface) {
    bool good = true;
    const ObjectRecord& record = surface.record();
    const double largest = record.grid.Error(record.error_code_max);
    for (double threshold = 2 * record.grid.step; threshold < 2 * largest; threshold *= 2) {
      Query query;
      query.threshold = ConstantThreshold(threshold);
      ExtractStats stats;
      const TriangleMesh cut = ExtractMesh(surface, query, &stats);
      const double measured = Measure(cut);
      const double ratio = measured / stats.error_bound;
      const double forced = stats.nodes_applied == 0
                                ? 0
                                : 100.0 * static_cast<double>(stats.nodes_forced) /
                                      static_cast<double>(stats.nodes_applied);
      const double steps = threshold / record.grid.step;
      const double diagonal = record.diagonal();
      rows_.push_back({{"mesh", name_},
                       {"threshold_steps", steps},
                       {"triangles", stats.triangles},
                       {"promised_rel", stats.error_bound / diagonal},
                       {"measured_rel", measured / diagonal},
                       {"ratio", ratio},
                       {"forced_percent", forced}});
      if (arguments_.json.empty()) {
        std::printf("%-36s %9.0f %9llu %11.3e %11.3e %8.3f %8.3f\n", name_.c_str(), steps,
                    static_cast<unsigned long long>(stats.triangles), stats.error_bound / diagonal,
                    measured / diagonal, ratio, forced);
        std::fflush(stdout);
      }
      if (!(measured <= stats.error_bound)) {
        std::fprintf(stderr, "%s: the bound does not hold at %g steps\n", name_.c_str(), steps);
        good = false;
      }
    }
    return good;
  }

  const Arguments& arguments_;
  std::string name_;
  TriangleMesh mesh_;
  Json rows_ = Json::array();
};

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Measures the quality of mtdb's cuts.");
  app.add_option("mesh", arguments.meshes, "Mesh files")->required();
  app.add_option("--samples", arguments.samples, "Points on each of the two surfaces");
  app.add_option("--threads", arguments.threads, "Of the build");
  app.add_option("--bits", arguments.bits, "Of the grid");
  app.add_option("--ratio", arguments.ratios, "Triangles of the cuts, to those of the mesh");
  app.add_option("--json", arguments.json, "Write the rows to a file; no table");
  app.add_flag("--measure-only", arguments.measure_only, "A cut that is worse is no failure");
  app.add_flag("--bounds", arguments.bounds, "Promised and measured errors instead of peers");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (arguments.json.empty() && arguments.bounds) {
    std::printf("%-36s %9s %9s %11s %11s %8s %8s\n", "mesh", "steps", "triangles", "promised/d",
                "measured/d", "ratio", "forced%");
  } else if (arguments.json.empty()) {
    std::printf("%-36s %6s %-16s %9s %11s %8s\n", "mesh", "ratio", "method", "triangles",
                "hausdorff/d", "to mtdb");
  }
  Bench bench(arguments);
  bool good = true;
  for (const std::string& path : arguments.meshes) good &= bench.Run(path);
  if (!arguments.json.empty()) good &= WriteRows(arguments.json, bench.rows());
  return good ? 0 : 1;
}

}  // namespace

}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
