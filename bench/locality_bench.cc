// SPDX-License-Identifier: Apache-2.0
// What a region costs to read.
//
//   locality_bench stores STORE... [--queries N] [--json FILE]
//   locality_bench layouts [--triangles N] [--queries N] [--json FILE]
//
// stores: the same boxes at the same errors from stores of one shape in several samplings (the
// first object of each; `mtdb generate sculpture` with one seed makes such shapes), each query from
// an empty cache, one thread. For each error, the sums over the boxes: clusters read, kilobytes of
// payloads, triangles, milliseconds of processor time (the best of three); and each relative to the
// first store. A finer sampling has more detail, so that at small errors the answers grow: costs
// are to follow them, not the stores.
//
// layouts: boxes of random places and sizes at random errors, each query from an empty cache, on a
// generated sculpture stored with several sizes of tiles and reductions. For each of them, means
// over the queries: clusters read; payload bytes read to those of the nodes that the answer applies
// (a node counts with its cluster's bytes a node); triangles. Then the same clusters in values of
// 64 KiB, filled in three orders: by round and place on the round's curve, by the place of the
// cluster's middle on one curve for all rounds, and as built (finest round first): distinct values,
// distinct pages of 4 KiB, and runs of neighbouring pages, that is reads.
//
// Checks that each query reads the clusters that its statistics say.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "bench/internal/workload.h"
#include "query/region.h"
#include "query/threshold.h"
#include "store/base/check.h"
#include "store/base/hilbert.h"

namespace mtdb {
namespace {

struct BoxQuery {
  Box3d box;
  double error = 0;  // model units; 0: full resolution
};

// Notes which clusters are read; root pieces, which every query reads, are not among them.
class NotingSource final : public ClusterSource {
 public:
  explicit NotingSource(std::shared_ptr<ClusterSource> source) : source_(std::move(source)) {}
  const ObjectRecord& record() const override { return source_->record(); }
  const ClusterIndex& index() const override { return source_->index(); }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override {
    for (const UnitId unit : units) {
      if (index().unit(unit).nodes > 0) read.push_back(unit);
    }
    source_->Read(units, std::move(receiver));
  }
  bool answers_at_once() const override { return source_->answers_at_once(); }

  std::vector<UnitId> read;

 private:
  const std::shared_ptr<ClusterSource> source_;
};

struct Cost {
  double clusters = 0;
  double kilobytes = 0;
  double triangles = 0;
  double milliseconds = 0;
};

struct Answer {
  Cost cost;
  double needed_bytes = 0;  // of the applied nodes
  std::vector<UnitId> clusters;
};

// From an empty cache.
Answer Ask(const std::shared_ptr<ClusterSource>& source, const BoxQuery& q) {
  const auto noting = std::make_shared<NotingSource>(source);
  const auto surface = Surface::Open(noting, {.threads = 1}).value();
  Query query;
  query.region = BoxRegion(q.box);
  if (q.error > 0) query.threshold = ConstantThreshold(q.error);
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const double begin = ProcessCpuSeconds();
  Cut cut = surface->Select(query).value();
  const Status status = cut.Emit(sink);
  const double seconds = ProcessCpuSeconds() - begin;
  MTDB_CHECK(status.ok(), status.message().c_str());
  const ExtractStats& stats = cut.stats();
  MTDB_CHECK(stats.clusters_read == noting->read.size(), "the clusters are counted");
  MTDB_CHECK(stats.triangles == mesh.triangles.size(), "the triangles are counted");
  Answer answer{
      {static_cast<double>(stats.clusters_read), 1e-3 * static_cast<double>(stats.bytes_read),
       static_cast<double>(stats.triangles), 1e3 * seconds},
      0,
      std::move(noting->read)};
  const ClusterIndex& index = source->index();
  for (const UnitId id : answer.clusters) {
    const uint32_t nodes = index.unit(id).nodes;
    uint32_t applied = 0;
    for (NodeIndex node = 0; node < nodes; ++node) applied += cut.applied(id, node) ? 1 : 0;
    answer.needed_bytes += static_cast<double>(index.location(id).length) * applied / nodes;
  }
  return answer;
}

// Boxes around random vertices of a coarse mesh. Sides and errors are relative to the diagonal.
std::vector<BoxQuery> RandomBoxes(const std::shared_ptr<ClusterSource>& source, size_t count,
                                  std::span<const double> sides, std::span<const double> errors) {
  const auto surface = Surface::Open(source).value();
  Query coarse;
  coarse.max_triangles = 20000;
  ExtractStats stats;
  const TriangleMesh mesh = ExtractMesh(*surface, coarse, &stats);
  const double diagonal = surface->record().diagonal();
  std::mt19937 random(1);
  std::vector<BoxQuery> queries;
  for (size_t i = 0; i < count; ++i) {
    const Vec3d centre = mesh.positions[random() % mesh.positions.size()];
    const double half = 0.5 * diagonal * sides[random() % sides.size()];
    BoxQuery& q = queries.emplace_back();
    q.box.Add(centre - Vec3d{half, half, half});
    q.box.Add(centre + Vec3d{half, half, half});
    q.error = diagonal * errors[random() % errors.size()];
  }
  return queries;
}

std::shared_ptr<ClusterSource> OpenFirst(const Database& database) {
  const std::vector<ObjectRecord> objects = database.List().value();
  MTDB_CHECK(!objects.empty(), "the store has an object");
  return database.OpenObject(objects.front().name).value();
}

struct Arguments {
  std::vector<std::string> stores;
  uint64_t triangles = 2000000;
  size_t queries = 100;
  std::string json;  // a file
};

int CompareStores(const Arguments& arguments) {
  constexpr std::array kSides{0.02, 0.05, 0.1};
  constexpr std::array kErrors{4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4};
  constexpr int kTimes = 3;  // the best one counts
  std::vector<std::shared_ptr<Database>> databases;
  std::vector<std::shared_ptr<ClusterSource>> sources;
  for (const std::string& path : arguments.stores) {
    databases.push_back(Database::Open(path).value());
    sources.push_back(OpenFirst(*databases.back()));
  }
  Json rows = Json::array();
  if (arguments.json.empty()) {
    std::printf(
        "| error | triangles of the store | clusters read | KB | triangles | CPU ms |"
        " clusters, KB, triangles, ms: to the first store |\n|---|---|---|---|---|---|---|\n");
  }
  for (const double error : kErrors) {
    const std::vector<BoxQuery> queries =
        RandomBoxes(sources.front(), arguments.queries, kSides, {&error, 1});
    std::vector<Cost> costs;
    for (const auto& source : sources) {
      Cost& sum = costs.emplace_back();
      for (const BoxQuery& q : queries) {
        double best = std::numeric_limits<double>::max();
        Answer answer;
        for (int i = 0; i < kTimes; ++i) {
          answer = Ask(source, q);
          best = std::min(best, answer.cost.milliseconds);
        }
        sum.clusters += answer.cost.clusters;
        sum.kilobytes += answer.cost.kilobytes;
        sum.triangles += answer.cost.triangles;
        sum.milliseconds += best;
      }
      const Cost& first = costs.front();
      const Cost ratio{sum.clusters / first.clusters, sum.kilobytes / first.kilobytes,
                       sum.triangles / first.triangles, sum.milliseconds / first.milliseconds};
      rows.push_back({{"error", error},
                      {"store_triangles", source->record().triangles},
                      {"clusters", sum.clusters},
                      {"kilobytes", sum.kilobytes},
                      {"triangles", sum.triangles},
                      {"cpu_milliseconds", sum.milliseconds},
                      {"clusters_ratio", ratio.clusters},
                      {"kilobytes_ratio", ratio.kilobytes},
                      {"triangles_ratio", ratio.triangles},
                      {"cpu_ratio", ratio.milliseconds}});
      if (!arguments.json.empty()) continue;
      std::printf("| %g | %llu | %.0f | %.0f | %.0f | %.0f | %.2f, %.2f, %.2f, %.2f |\n", error,
                  static_cast<unsigned long long>(source->record().triangles), sum.clusters,
                  sum.kilobytes, sum.triangles, sum.milliseconds, ratio.clusters, ratio.kilobytes,
                  ratio.triangles, ratio.milliseconds);
    }
  }
  return arguments.json.empty() || WriteRows(arguments.json, rows) ? 0 : 1;
}

// Where each cluster lies when the clusters fill values one after the other in some order.
class Layout {
 public:
  Layout(const ClusterIndex& index, std::span<const uint32_t> order) : at_(order.size()) {
    uint64_t next = 0;
    for (const uint32_t c : order) {
      const uint64_t bytes = index.location(c).length;
      const uint64_t left = kValueBytes - next % kValueBytes;
      if (bytes > left && left < kValueBytes) next += left;
      at_[c] = {next, next + bytes};
      next += bytes;
    }
  }

  struct Touched {
    double values = 0;
    double pages = 0;
    double runs = 0;
  };
  Touched Touch(std::span<const UnitId> clusters) const {
    std::vector<uint64_t> values, pages;
    for (const UnitId id : clusters) {
      const auto [begin, end] = at_[id];
      for (uint64_t v = begin / kValueBytes; v * kValueBytes < end; ++v) values.push_back(v);
      for (uint64_t p = begin / kPageBytes; p * kPageBytes < end; ++p) pages.push_back(p);
    }
    for (auto* list : {&values, &pages}) {
      std::ranges::sort(*list);
      list->erase(std::unique(list->begin(), list->end()), list->end());
    }
    Touched touched{static_cast<double>(values.size()), static_cast<double>(pages.size()), 0};
    for (size_t i = 0; i < pages.size(); ++i) {
      touched.runs += i == 0 || pages[i] != pages[i - 1] + 1 ? 1 : 0;
    }
    return touched;
  }

 private:
  static constexpr uint64_t kValueBytes = 65536;
  static constexpr uint64_t kPageBytes = 4096;
  struct Range {
    uint64_t begin;
    uint64_t end;
  };
  std::vector<Range> at_;  // per cluster
};

struct Order {
  const char* name;
  Layout layout;
};

std::vector<Order> Orders(const ClusterIndex& index) {
  std::vector<uint32_t> built(index.cluster_count());
  std::iota(built.begin(), built.end(), 0);
  std::vector<uint32_t> by_round = built;
  std::ranges::stable_sort(by_round, std::greater<>(),
                           [&](uint32_t c) { return index.unit(c).round; });
  Box3i bounds;
  for (const uint32_t c : built) bounds.Add(index.unit(c).bounds);
  const auto place = [&](uint32_t c) {
    const Box3i& b = index.unit(c).bounds;
    std::array<uint32_t, 3> at{};
    for (int i = 0; i < 3; ++i) {
      const double middle = 0.5 * (static_cast<double>(b.min[i]) + b.max[i]) - bounds.min[i];
      const double extent = std::max(1.0, static_cast<double>(bounds.max[i]) - bounds.min[i]);
      at[static_cast<size_t>(i)] =
          static_cast<uint32_t>(middle / extent * ((1 << kHilbertBits) - 1));
    }
    return HilbertCode(at);
  };
  std::vector<uint32_t> by_place = built;
  std::ranges::sort(by_place, {}, place);
  std::vector<Order> orders;
  orders.push_back({"round, then curve", Layout(index, by_round)});
  orders.push_back({"one curve", Layout(index, by_place)});
  orders.push_back({"as built", Layout(index, built)});
  return orders;
}

// All queries on one store.
struct LayoutTotals {
  Cost sum;
  double needed_kilobytes = 0;
  std::vector<Layout::Touched> touched;  // by order
};
LayoutTotals AskAll(const std::shared_ptr<ClusterSource>& source,
                    const std::vector<BoxQuery>& queries, const std::vector<Order>& orders) {
  LayoutTotals totals;
  totals.touched.resize(orders.size());
  for (const BoxQuery& q : queries) {
    const Answer answer = Ask(source, q);
    totals.sum.clusters += answer.cost.clusters;
    totals.sum.kilobytes += answer.cost.kilobytes;
    totals.sum.triangles += answer.cost.triangles;
    totals.sum.milliseconds += answer.cost.milliseconds;
    totals.needed_kilobytes += 1e-3 * answer.needed_bytes;
    for (size_t o = 0; o < orders.size(); ++o) {
      const Layout::Touched t = orders[o].layout.Touch(answer.clusters);
      totals.touched[o].values += t.values;
      totals.touched[o].pages += t.pages;
      totals.touched[o].runs += t.runs;
    }
  }
  return totals;
}

int CompareLayouts(const Arguments& arguments) {
  constexpr std::array kSides{0.01, 0.03, 0.1, 0.3};
  constexpr std::array kErrors{0.0, 1e-4, 3e-4, 1e-3};
  struct Shape {
    uint32_t tile_triangles;
    uint32_t reduction;
  };
  constexpr std::array kShapes{Shape{2048, 4}, Shape{4096, 4}, Shape{8192, 4}, Shape{16384, 4},
                               Shape{8192, 8}};
  Json rows = Json::array();
  std::vector<BoxQuery> queries;  // the same for all
  if (arguments.json.empty()) {
    std::printf(
        "| tile triangles | reduction | file, bits a vertex | clusters read | KB read | read / "
        "needed |"
        " triangles | CPU ms | order | values | pages | runs |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  }
  for (const Shape& shape : kShapes) {
    BenchStore here;
    BuildOptions options;
    options.tile_triangles = shape.tile_triangles;
    options.reduction = shape.reduction;
    const ObjectRecord record = here.Build("s", Sculpture(arguments.triangles), options);
    const auto database = Database::Open(here.path()).value();
    const std::shared_ptr<ClusterSource> source = OpenFirst(*database);
    if (queries.empty()) queries = RandomBoxes(source, arguments.queries, kSides, kErrors);
    const std::vector<Order> orders = Orders(source->index());
    const auto [sum, needed_kilobytes, touched] = AskAll(source, queries, orders);
    const auto n = static_cast<double>(queries.size());
    const double bits = 8.0 * static_cast<double>(database->FileBytes().value()) /
                        static_cast<double>(record.vertices);
    for (size_t o = 0; o < orders.size(); ++o) {
      rows.push_back({{"tile_triangles", shape.tile_triangles},
                      {"reduction", shape.reduction},
                      {"bits_per_vertex", bits},
                      {"clusters", sum.clusters / n},
                      {"kilobytes", sum.kilobytes / n},
                      {"read_to_needed", sum.kilobytes / needed_kilobytes},
                      {"triangles", sum.triangles / n},
                      {"cpu_milliseconds", sum.milliseconds / n},
                      {"order", orders[o].name},
                      {"values", touched[o].values / n},
                      {"pages", touched[o].pages / n},
                      {"runs", touched[o].runs / n}});
      if (!arguments.json.empty()) continue;
      std::printf(
          "| %u | %u | %.1f | %.1f | %.0f | %.2f | %.0f | %.1f | %s | %.1f | %.0f | %.1f |\n",
          shape.tile_triangles, shape.reduction, bits, sum.clusters / n, sum.kilobytes / n,
          sum.kilobytes / needed_kilobytes, sum.triangles / n, sum.milliseconds / n, orders[o].name,
          touched[o].values / n, touched[o].pages / n, touched[o].runs / n);
    }
  }
  return arguments.json.empty() || WriteRows(arguments.json, rows) ? 0 : 1;
}

int Main(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Measures what a region costs to read.");
  app.require_subcommand(1);
  CLI::App* stores = app.add_subcommand("stores", "One shape in several samplings");
  stores->add_option("store", arguments.stores, "Stores")->required();
  CLI::App* layouts = app.add_subcommand("layouts", "Sizes of clusters and orders of their keys");
  layouts->add_option("--triangles", arguments.triangles, "Of the generated sculpture");
  for (CLI::App* verb : {stores, layouts}) {
    verb->add_option("--queries", arguments.queries, "Number of boxes")->check(CLI::PositiveNumber);
    verb->add_option("--json", arguments.json, "Write the rows to a file; no table");
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return stores->parsed() ? CompareStores(arguments) : CompareLayouts(arguments);
}

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) { return mtdb::Main(argc, argv); }
