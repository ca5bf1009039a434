// SPDX-License-Identifier: Apache-2.0
// How fast a store answers.
//
//   query_bench [--triangles=N] [--benchmark_filter=...]
//
// Workloads, on a store of a generated sculpture of 2,000,000 (or N) triangles:
//   BM_WarmUniform/K     a uniform cut of K thousand triangles into a TriangleMesh that is filled
//                        again, clusters in the cache, one thread. items_per_second: triangles
//                        delivered; select_M and emit_M: millions a second of either stage.
//   BM_WarmFull          full resolution, likewise.
//   BM_WarmBox/P         full resolution in a box of a side of P per mille of the diagonal,
//   likewise;
//                        outside_percent: triangles that do not meet the box, to those that do.
//   BM_WarmBudget/K      the same cuts as BM_WarmUniform, found by a budget of triangles.
//   BM_ColdBox           a box from a new handle with an empty cache (the system's file cache is
//                        warm): clusters and kilobytes read.
//   BM_ColdFull/T        the whole surface at full resolution from a new handle, with T threads.
//                        Real time.
//   BM_FormUniform/F/K   a uniform cut of K thousand triangles, no mesh is kept; F: 0 explicit, 1
//                        implicit. K = 0: full resolution. cache_MB and resident_MB between
//                        queries, the second the growth of the resident set; peak_MB: the cache
//                        during a query.
//   BM_FormBox/F/P       likewise, full resolution in a box as in BM_WarmBox.
//   BM_DecodeClusters    reading, checking and decoding every cluster, one thread.
//                        items_per_second: nodes.
//   BM_Threads/N/M       N threads ask 60 random boxes each of one handle with a cache of M MB, no
//                        mesh is kept. Real time; cpu_M: millions of triangles per second of
//                        processor time; p99_ms of a query; resident_MB: the growth of the resident
//                        set. Fails when that exceeds the cache by more than 64 MiB.
//   BM_CacheHits/N       N threads take and let go of units that are in the cache.
// Rates are per second of processor time, of all threads, but where real time is said.
// Each checks its answer: counts against the record, the mesh against the statistics.
#include <algorithm>
#include <atomic>
#include <benchmark/benchmark.h>
#include <chrono>
#include <cmath>
#include <functional>
#include <malloc.h>
#include <random>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "bench/internal/workload.h"
#include "query/cache/cluster_cache.h"
#include "query/cache/unit_reader.h"

namespace mtdb {

using namespace internal;

namespace {

uint64_t store_triangles = 2000000;

const BenchStore& Store() {
  static BenchStore store;
  static const ObjectRecord kRecord =
      store.Build("sculpture", Sculpture(store_triangles), BuildOptions{});
  MTDB_CHECK(kRecord.triangles == Sculpture(store_triangles).triangles.size(), "all is stored");
  return store;
}

std::shared_ptr<Surface> OpenWith(unsigned threads, size_t cache_bytes = size_t{512} << 20) {
  return Store().OpenSurface("sculpture", {.cache_bytes = cache_bytes, .threads = threads});
}

// A box around a vertex of the surface, of a side relative to the diagonal.
Query BoxQuery(const ObjectRecord& record, size_t vertex, double side) {
  const Vec3d centre = Sculpture(store_triangles).positions[vertex];
  const double half = 0.5 * side * record.diagonal();
  Box3d box;
  box.Add(centre - Vec3d{half, half, half});
  box.Add(centre + Vec3d{half, half, half});
  Query query;
  query.region = BoxRegion(box);
  return query;
}

// Counts what arrives, and keeps nothing.
class CountingSink final : public MeshSink {
 public:
  Status Begin(const MeshHeader&) override { return Status::Ok(); }
  Status AddVertices(std::span<const Vec3d> positions, ByteSpan) override {
    vertices += positions.size();
    return Status::Ok();
  }
  Status AddTriangles(std::span<const TriangleVertices> block) override {
    triangles += block.size();
    return Status::Ok();
  }
  Status End() override { return Status::Ok(); }
  uint64_t vertices = 0;
  uint64_t triangles = 0;
};

ExtractStats Count(benchmark::State& state, const Surface& surface, const Query& query) {
  CountingSink sink;
  const ExtractStats stats = surface.Extract(query, sink).value();
  if (sink.triangles != stats.triangles || sink.vertices != stats.vertices) {
    state.SkipWithError("the mesh is not what the statistics say");
  }
  return stats;
}

void Deliver(benchmark::State& state, const ExtractStats& stats) {
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(stats.triangles));
  state.counters["triangles"] = static_cast<double>(stats.triangles);
}

// Warm: the query again and again, into one mesh.
ExtractStats Repeat(benchmark::State& state, const Surface& surface, const Query& query) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  ExtractStats stats = surface.Extract(query, sink).value();
  double select = 0;
  double emit = 0;
  for (auto _ : state) {
    stats = surface.Extract(query, sink).value();
    select += stats.seconds.select;
    emit += stats.seconds.emit;
  }
  if (stats.clusters_read != 0) state.SkipWithError("not warm");
  if (mesh.triangles.size() != stats.triangles || mesh.positions.size() != stats.vertices) {
    state.SkipWithError("the mesh is not what the statistics say");
  }
  Deliver(state, stats);
  const double millions =
      1e-6 * static_cast<double>(state.iterations()) * static_cast<double>(stats.triangles);
  state.counters["select_M"] = millions / select;
  state.counters["emit_M"] = millions / emit;
  return stats;
}

void BM_WarmBudget(benchmark::State& state) {
  Query query;
  query.max_triangles = 1000 * static_cast<uint64_t>(state.range(0));
  Repeat(state, *OpenWith(1), query);
}

// The threshold that a budget stands for: thresholds are the common query.
void BM_WarmUniform(benchmark::State& state) {
  const std::shared_ptr<Surface> surface = OpenWith(1);
  Query query;
  query.max_triangles = 1000 * static_cast<uint64_t>(state.range(0));
  const ExtractStats budget = Count(state, *surface, query);
  query.max_triangles.reset();
  query.threshold = ConstantThreshold(budget.error_bound);
  Repeat(state, *surface, query);
}

void BM_WarmFull(benchmark::State& state) { Repeat(state, *OpenWith(1), Query{}); }

void BM_WarmBox(benchmark::State& state) {
  const std::shared_ptr<Surface> surface = OpenWith(1);
  const double side = 1e-3 * static_cast<double>(state.range(0));
  Query query = BoxQuery(surface->record(), Sculpture(store_triangles).positions.size() / 3, side);
  const ExtractStats stats = Repeat(state, *surface, query);
  query.clip = true;
  const ExtractStats inside = Count(state, *surface, query);
  state.counters["inside"] = static_cast<double>(inside.triangles);
  state.counters["outside_percent"] = 100.0 *
                                      static_cast<double>(stats.triangles - inside.triangles) /
                                      static_cast<double>(inside.triangles);
}

// Warm, with what the form keeps.
void RepeatInForm(benchmark::State& state, const std::function<Query(const Surface&)>& make) {
  Store();
  malloc_trim(0);
  ResetPeakMemory();
  const uint64_t before = PeakMemoryBytes();
  const std::shared_ptr<Surface> surface = Store().OpenSurface(
      "sculpture", {.cache_bytes = size_t{512} << 20,
                    .form = state.range(0) == 0 ? RuntimeForm::kExplicit : RuntimeForm::kImplicit,
                    .threads = 1});
  const Query query = make(*surface);
  ExtractStats stats = Count(state, *surface, query);
  for (auto _ : state) stats = Count(state, *surface, query);
  if (stats.bytes_read != 0) state.SkipWithError("not warm");
  malloc_trim(0);
  ResetPeakMemory();
  Deliver(state, stats);
  state.counters["clusters"] = static_cast<double>(stats.clusters_used);
  state.counters["cache_MB"] = static_cast<double>(surface->cache().bytes()) / 1e6;
  state.counters["peak_MB"] = static_cast<double>(surface->cache().peak_bytes()) / 1e6;
  state.counters["resident_MB"] =
      (static_cast<double>(PeakMemoryBytes()) - static_cast<double>(before)) / 1e6;
}

void BM_FormUniform(benchmark::State& state) {
  RepeatInForm(state, [&](const Surface&) {
    Query query;
    if (state.range(1) == 0) return query;  // full resolution
    query.max_triangles = 1000 * static_cast<uint64_t>(state.range(1));
    const std::shared_ptr<Surface> other = OpenWith(1);
    const ExtractStats budget = Count(state, *other, query);
    query.max_triangles.reset();
    query.threshold = ConstantThreshold(budget.error_bound);
    return query;
  });
}

void BM_FormBox(benchmark::State& state) {
  RepeatInForm(state, [&](const Surface& surface) {
    return BoxQuery(surface.record(), Sculpture(store_triangles).positions.size() / 3,
                    1e-3 * static_cast<double>(state.range(1)));
  });
}

void BM_ColdBox(benchmark::State& state) {
  Store();
  ExtractStats stats;
  for (auto _ : state) {
    const std::shared_ptr<Surface> surface = OpenWith(1);
    stats = Count(state, *surface, BoxQuery(surface->record(), store_triangles / 6, 0.09));
  }
  if (stats.clusters_read == 0) state.SkipWithError("not cold");
  Deliver(state, stats);
  state.counters["clusters_read"] = static_cast<double>(stats.clusters_read);
  state.counters["clusters_total"] = static_cast<double>(stats.clusters_total);
  state.counters["kilobytes_read"] = static_cast<double>(stats.bytes_read) / 1e3;
}

void BM_ColdFull(benchmark::State& state) {
  Store();
  ExtractStats stats;
  for (auto _ : state) {
    stats = Count(state, *OpenWith(static_cast<unsigned>(state.range(0))), Query{});
  }
  if (stats.triangles != Sculpture(store_triangles).triangles.size()) {
    state.SkipWithError("not the whole surface");
  }
  Deliver(state, stats);
}

void BM_Threads(benchmark::State& state) {
  constexpr int kQueries = 60;
  const auto threads = static_cast<size_t>(state.range(0));
  const size_t cache_bytes = static_cast<size_t>(state.range(1)) << 20;
  const std::shared_ptr<Surface> surface = OpenWith(1, cache_bytes);
  malloc_trim(0);  // what was freed before does not count
  ResetPeakMemory();
  const uint64_t before = PeakMemoryBytes();
  std::vector<std::vector<double>> seconds(threads);
  std::atomic<uint64_t> triangles{0};
  std::atomic<bool> failed{false};
  const auto ask = [&](size_t t) {
    std::mt19937 random(static_cast<unsigned>(t));
    for (int i = 0; i < kQueries; ++i) {
      Query query =
          BoxQuery(surface->record(), random() % Sculpture(store_triangles).positions.size(),
                   std::ldexp(0.2, -static_cast<int>(random() % 4)));
      query.threshold = ConstantThreshold(1e-4 * surface->record().diagonal());
      CountingSink sink;
      const auto start = std::chrono::steady_clock::now();
      const Result<ExtractStats> stats = surface->Extract(query, sink);
      const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
      if (!stats.ok() || sink.triangles != stats->triangles) failed = true;
      seconds[t].push_back(took.count());
      triangles += sink.triangles;
    }
  };
  const double cpu_before = ProcessCpuSeconds();
  for (auto _ : state) {
    std::vector<std::thread> all;
    for (size_t t = 0; t < threads; ++t) all.emplace_back(ask, t);
    for (std::thread& thread : all) thread.join();
  }
  const double cpu = ProcessCpuSeconds() - cpu_before;
  const uint64_t grown = PeakMemoryBytes() - before;
  if (failed) state.SkipWithError("a query failed");
  if (grown > cache_bytes + (64 << 20)) state.SkipWithError("resident beyond the budget");
  if (surface->cache().peak_bytes() > cache_bytes) state.SkipWithError("cache beyond its budget");
  std::vector<double> sorted;
  for (const auto& of_thread : seconds)
    sorted.insert(sorted.end(), of_thread.begin(), of_thread.end());
  std::sort(sorted.begin(), sorted.end());
  state.SetItemsProcessed(static_cast<int64_t>(triangles));
  state.counters["cpu_M"] = 1e-6 * static_cast<double>(triangles) / cpu;
  state.counters["p50_ms"] = 1e3 * sorted[sorted.size() / 2];
  state.counters["p99_ms"] = 1e3 * sorted[sorted.size() * 99 / 100];
  state.counters["resident_MB"] = static_cast<double>(grown) / (1 << 20);
}

void BM_CacheHits(benchmark::State& state) {
  constexpr uint32_t kHits = 200000;
  const std::shared_ptr<Surface> surface = OpenWith(1);
  Count(state, *surface, Query{});
  const auto threads = static_cast<size_t>(state.range(0));
  const uint32_t units = surface->index().unit_count();
  std::atomic<bool> failed{false};
  for (auto _ : state) {
    std::vector<std::thread> all;
    for (size_t t = 0; t < threads; ++t) {
      all.emplace_back([&, t] {
        UnitReader reader(surface->cache(), {});
        std::mt19937 random(static_cast<unsigned>(t));
        for (uint32_t i = 0; i < kHits; ++i) {
          if (!reader.Get(random() % units).ok()) failed = true;
          reader.Release();
        }
      });
    }
    for (std::thread& thread : all) thread.join();
  }
  if (failed) state.SkipWithError("a unit was not there");
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(threads * kHits));
}

void BM_DecodeClusters(benchmark::State& state) {
  Store();
  uint64_t nodes = 0;
  for (auto _ : state) {
    const std::shared_ptr<Surface> surface = OpenWith(1);
    const ClusterIndex& index = surface->index();
    LoadStats stats;
    nodes = 0;
    for (UnitId unit = index.unit_count(); unit-- > 0;) {  // coarsest first: parents are there
      const LoadedUnitPtr loaded = surface->cache().Get(unit, &stats).value();
      nodes += loaded->nodes();
    }
    if (nodes != surface->record().nodes) state.SkipWithError("not every node was decoded");
  }
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(nodes));
}

BENCHMARK(BM_WarmUniform)
    ->ArgName("thousands")
    ->Arg(10)
    ->Arg(30)
    ->Arg(100)
    ->Arg(200)
    ->Arg(500)
    ->Arg(1000)
    ->Arg(1900)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_WarmFull)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_WarmBox)
    ->ArgName("per_mille")
    ->Arg(90)
    ->Arg(200)
    ->Arg(600)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_WarmBudget)
    ->ArgName("thousands")
    ->Arg(200)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ColdBox)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ColdFull)
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_FormUniform)
    ->ArgNames({"implicit", "thousands"})
    ->ArgsProduct({{0, 1}, {100, 500, 0}})
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_FormBox)
    ->ArgNames({"implicit", "per_mille"})
    ->ArgsProduct({{0, 1}, {90, 200, 600}})
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_DecodeClusters)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_Threads)
    ->ArgNames({"threads", "cache_MB"})
    ->Args({1, 256})
    ->Args({2, 256})
    ->Args({8, 256})
    ->Args({2, 48})
    ->Args({8, 48})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_CacheHits)
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->Arg(8)
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mtdb

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  constexpr std::string_view kOption = "--triangles=";
  if (argc > 1 && std::string_view(argv[1]).starts_with(kOption)) {
    mtdb::store_triangles = std::stoull(argv[1] + kOption.size());
    argv[1] = argv[0];
    --argc;
    ++argv;
  }
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
