// SPDX-License-Identifier: Apache-2.0
// How many triangles mtdb's uniform cuts need for a measured distance, against another build of
// mtdb.
//
//   curve_bench [--samples N] [--threads N] [--bits N] [--tile N] [--reduction N]
//               [--sculpture N]... [--repeat N] [--json FILE] [--against FILE] [MESH...]
//
// Builds each mesh, takes the uniform cut of every error code between 50 % and 0.2 % of the
// triangles, and measures its symmetric Hausdorff distance to the mesh (internal/hausdorff.h).
// Prints a row a mesh: promised errors' quality (the least measured / promised at 3 % and coarser),
// forced nodes (the largest share, and the share over all cuts), and what the build took. --json
// keeps all of it. --against takes a file that another build wrote so, and prints this one's
// figures over that one's: triangles at equal measured distance at 30, 10, 3, 1 and 0.3 % of the
// triangles (the distance that the other build reaches with them; between cuts, distances are
// interpolated log by log), bits a vertex, depth, processor time (the least of --repeat builds),
// peak memory, with geometric means.
//
// Exits with 1 when a measured distance exceeds the promised one.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bench/internal/hausdorff.h"
#include "bench/internal/workload.h"
#include "codecs/mesh_file/mesh_file.h"

namespace mtdb {

namespace {

constexpr double kRatios[] = {0.3, 0.1, 0.03, 0.01, 0.003};
constexpr double kFinest = 0.5;  // of the triangles: cuts that are measured
constexpr double kCoarsest = 0.002;
constexpr double kPromiseRatio = 0.03;  // measured / promised is told of cuts from here on
// Of each mesh, compared with the other build's.
constexpr const char* kCosts[] = {"bits_per_vertex", "depth", "clusters", "cpu_seconds", "peak_mb"};

struct Arguments {
  std::vector<std::string> meshes;
  std::vector<uint64_t> sculptures;
  uint64_t samples = 100000;
  unsigned threads = 1;
  int bits = 16;
  int repeat = 1;
  BuildOptions build;
  std::string json;
  std::string against;
};

struct CutPoint {
  double triangles = 0;
  double distance = 0;
};

// The cuts that are better than every smaller one, by falling triangles.
class Curve {
 public:
  explicit Curve(std::vector<CutPoint> cuts) {
    std::sort(cuts.begin(), cuts.end(),
              [](const CutPoint& a, const CutPoint& b) { return a.triangles < b.triangles; });
    for (const CutPoint& cut : cuts) {
      if (cut.distance > 0 && (cuts_.empty() || cut.distance < cuts_.back().distance)) {
        cuts_.push_back(cut);
      }
    }
  }
  // None outside of what was measured.
  std::optional<double> DistanceAt(double triangles) const {
    return Interpolate(triangles, [](const CutPoint& cut) {
      return std::pair{cut.triangles, cut.distance};
    });
  }
  std::optional<double> TrianglesAt(double distance) const {
    return Interpolate(distance, [](const CutPoint& cut) {
      return std::pair{cut.distance, cut.triangles};
    });
  }

 private:
  template <typename F>
  std::optional<double> Interpolate(double x, const F& pair) const {
    for (size_t i = 0; i + 1 < cuts_.size(); ++i) {
      const auto [xa, ya] = pair(cuts_[i]);
      const auto [xb, yb] = pair(cuts_[i + 1]);
      if ((x - xa) * (x - xb) > 0) continue;
      const double t = xa == xb ? 0 : std::log(x / xa) / std::log(xb / xa);
      return ya * std::pow(yb / ya, t);
    }
    return std::nullopt;
  }
  std::vector<CutPoint> cuts_;  // by growing triangles and falling distance
};

// Of the rows of one mesh.
Curve CurveOf(const Json& rows, const std::string& mesh) {
  std::vector<CutPoint> cuts;
  for (const Json& row : rows) {
    if (row["mesh"] == mesh && row.contains("measured_rel")) {
      cuts.push_back({row["triangles"].get<double>(), row["measured_rel"].get<double>()});
    }
  }
  return Curve(std::move(cuts));
}

std::optional<Json> SummaryOf(const Json& rows, const std::string& mesh) {
  for (const Json& row : rows) {
    if (row["mesh"] == mesh && row.contains("nodes")) return row;
  }
  return std::nullopt;
}

class Bench {
 public:
  explicit Bench(const Arguments& arguments) : arguments_(arguments) {}

  // False when a bound does not hold.
  bool Run(const std::string& name, const TriangleMesh& mesh) {
    std::optional<BenchStore> store;
    ObjectRecord record;
    double cpu = INFINITY;
    double peak_mb = INFINITY;
    for (int i = 0; i < std::max(1, arguments_.repeat); ++i) {
      store.emplace();
      BuildOptions options = arguments_.build;
      options.threads = arguments_.threads;
      options.bits = arguments_.bits;
      ResetPeakMemory();
      const double begin = ProcessCpuSeconds();
      record = store->Build("mesh", mesh, options);
      cpu = std::min(cpu, ProcessCpuSeconds() - begin);
      peak_mb = std::min(peak_mb, static_cast<double>(PeakMemoryBytes()) / 1e6);
    }
    const std::shared_ptr<Surface> surface = store->OpenSurface("mesh");
    const bool good = MeasureCuts(name, mesh, *surface);
    const Json summary = {{"mesh", name},
                          {"nodes", record.nodes},
                          {"clusters", record.clusters},
                          {"rounds", record.rounds.size()},
                          {"root_triangles", record.root_triangles},
                          {"depth", record.depth},
                          {"bits_per_vertex", 8.0 * static_cast<double>(record.stored_bytes) /
                                                  static_cast<double>(record.vertices)},
                          {"cpu_seconds", cpu},
                          {"peak_mb", peak_mb},
                          {"least_measured_over_promised", least_ratio_},
                          {"median_measured_over_promised", median_ratio_},
                          {"most_forced_percent", most_forced_},
                          {"forced_percent", 100.0 * forced_ / std::max(1.0, applied_)}};
    rows_.push_back(summary);
    std::printf("%-28.28s %8.3f %8.3f %8.3f %8.3f %8.2f %6u %7u %7zu %8llu %8.2f %8.1f\n",
                name.c_str(), least_ratio_, median_ratio_, most_forced_,
                summary["forced_percent"].get<double>(), summary["bits_per_vertex"].get<double>(),
                record.depth, record.clusters, record.rounds.size(),
                static_cast<unsigned long long>(record.root_triangles), cpu, peak_mb);
    std::fflush(stdout);
    names_.push_back(name);
    return good;
  }

  // This build's figures over those of `other`, a row a mesh.
  void Compare(const Json& other) const {
    std::printf("\n%-28s", "over the other build");
    for (const double ratio : kRatios) std::printf(" %8g%%", 100 * ratio);
    for (const char* cost : kCosts) std::printf(" %15s", cost);
    std::printf("\n");
    std::map<std::string, std::vector<double>> columns;
    for (const std::string& name : names_) {
      const std::optional<Json> theirs = SummaryOf(other, name);
      if (!theirs) continue;
      const Json ours = *SummaryOf(rows_, name);
      const double triangles = FullTriangles(name);
      const Curve our_curve = CurveOf(rows_, name);
      const Curve their_curve = CurveOf(other, name);
      std::printf("%-28.28s", name.c_str());
      for (const double ratio : kRatios) {
        const std::optional<double> distance = their_curve.DistanceAt(ratio * triangles);
        const std::optional<double> needed =
            distance ? our_curve.TrianglesAt(*distance) : std::nullopt;
        if (needed) columns[std::to_string(ratio)].push_back(*needed / (ratio * triangles));
        if (needed) std::printf(" %9.3f", *needed / (ratio * triangles));
        if (!needed) std::printf(" %9s", "-");
      }
      for (const char* cost : kCosts) {
        columns[cost].push_back(ours[cost].get<double>() / (*theirs)[cost].get<double>());
        std::printf(" %15.3f", columns[cost].back());
      }
      std::printf("\n");
    }
    std::printf("%-28s", "geometric mean");
    for (const double ratio : kRatios) std::printf(" %9.3f", Mean(columns[std::to_string(ratio)]));
    for (const char* cost : kCosts) std::printf(" %15.3f", Mean(columns[cost]));
    std::printf("\n");
  }

  const Json& rows() const { return rows_; }

 private:
  bool MeasureCuts(const std::string& name, const TriangleMesh& mesh, const Surface& surface) {
    bool good = true;
    const ObjectRecord& record = surface.record();
    const auto full = static_cast<double>(record.triangles);
    std::vector<double> ratios;
    most_forced_ = forced_ = applied_ = 0;
    uint64_t last = 0;
    const HausdorffMeter meter(mesh, arguments_.samples);
    for (int code = 0; code <= record.error_code_max; ++code) {
      Query query;
      query.threshold = ConstantThreshold(record.grid.Error(static_cast<uint8_t>(code)));
      ExtractStats stats;
      const TriangleMesh cut = ExtractMesh(surface, query, &stats);
      const auto triangles = static_cast<double>(stats.triangles);
      if (triangles > kFinest * full || stats.triangles == last) continue;
      if (triangles < kCoarsest * full) break;
      last = stats.triangles;
      const double measured = meter.Distance(cut);
      const double ratio = measured / stats.error_bound;
      if (triangles <= kPromiseRatio * full) ratios.push_back(ratio);
      forced_ += static_cast<double>(stats.nodes_forced);
      applied_ += static_cast<double>(stats.nodes_applied);
      const double forced = 100.0 * static_cast<double>(stats.nodes_forced) /
                            static_cast<double>(std::max<uint64_t>(1, stats.nodes_applied));
      most_forced_ = std::max(most_forced_, forced);
      rows_.push_back({{"mesh", name},
                       {"full_triangles", record.triangles},
                       {"code", code},
                       {"triangles", stats.triangles},
                       {"promised_rel", stats.error_bound / record.diagonal()},
                       {"measured_rel", measured / record.diagonal()},
                       {"forced_percent", forced}});
      if (!(measured <= stats.error_bound)) {
        std::fprintf(stderr, "%s: %g measured, %g promised\n", name.c_str(), measured,
                     stats.error_bound);
        good = false;
      }
    }
    std::sort(ratios.begin(), ratios.end());
    least_ratio_ = ratios.empty() ? 0 : ratios.front();
    median_ratio_ = ratios.empty() ? 0 : ratios[ratios.size() / 2];
    return good;
  }

  double FullTriangles(const std::string& mesh) const {
    for (const Json& row : rows_) {
      if (row["mesh"] == mesh && row.contains("full_triangles")) {
        return row["full_triangles"].get<double>();
      }
    }
    return 0;
  }

  static double Mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double x : values) sum += std::log(x);
    return values.empty() ? 0 : std::exp(sum / static_cast<double>(values.size()));
  }

  const Arguments& arguments_;
  Json rows_ = Json::array();
  std::vector<std::string> names_;
  double least_ratio_ = 0;
  double median_ratio_ = 0;
  double most_forced_ = 0;
  double forced_ = 0;
  double applied_ = 0;
};

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Measures the triangles that uniform cuts need, against another build's.");
  app.add_option("mesh", arguments.meshes, "Mesh files");
  app.add_option("--sculpture", arguments.sculptures, "Generated meshes of so many triangles");
  app.add_option("--samples", arguments.samples, "Points on each of the two surfaces");
  app.add_option("--threads", arguments.threads, "Of the build");
  app.add_option("--bits", arguments.bits, "Of the grid");
  app.add_option("--tile", arguments.build.tile_triangles, "Triangles of a tile");
  app.add_option("--reduction", arguments.build.reduction, "Of a round");
  app.add_option("--repeat", arguments.repeat, "Builds a mesh; the least time and memory count");
  app.add_option("--json", arguments.json, "Keep the figures in a file");
  app.add_option("--against", arguments.against, "Figures of another build")
      ->check(CLI::ExistingFile);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  Json other;
  if (!arguments.against.empty()) {
    std::ifstream in(arguments.against);
    other = Json::parse(in, nullptr, false);
    if (!other.is_array()) {
      std::fprintf(stderr, "%s: not a file that curve_bench wrote\n", arguments.against.c_str());
      return 2;
    }
  }
  std::printf("%-28s %8s %8s %8s %8s %8s %6s %7s %7s %8s %8s %8s\n", "mesh", "meas/prm", "median",
              "forced%", "of all", "bits/v", "depth", "cluster", "rounds", "root", "cpu s",
              "peak MB");
  Bench bench(arguments);
  bool good = true;
  for (const std::string& path : arguments.meshes) {
    TriangleMesh mesh;
    TriangleMeshSink sink(&mesh);
    MeshReadReport report;
    if (const Status status = ReadMeshFile(path, sink, &report); !status.ok()) {
      std::fprintf(stderr, "%s\n", status.message().c_str());
      return 2;
    }
    good &= bench.Run(path.substr(path.rfind('/') + 1), mesh);
  }
  for (const uint64_t triangles : arguments.sculptures) {
    good &= bench.Run("sculpture " + std::to_string(triangles), Sculpture(triangles));
  }
  if (!arguments.against.empty()) bench.Compare(other);
  if (!arguments.json.empty()) good &= WriteRows(arguments.json, bench.rows());
  return good ? 0 : 1;
}

}  // namespace

}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
