// How fast a store answers.
//
//   query_bench [--benchmark_filter=...]
//
// Workloads, on a store of a generated sculpture of 1,000,000 triangles:
//   BM_WarmUniform/P     a uniform cut of P per mille of the triangles, clusters in the cache.
//                        items_per_second: triangles delivered.
//   BM_WarmBox           full resolution in a box of about 1 % of the surface, in the cache.
//                        outside_percent: triangles that do not meet the box, to those that do.
//   BM_ColdBox           the same from a new handle with an empty cache (the system's file cache is
//                        warm): clusters and kilobytes read.
//   BM_StreamFull        the whole surface at full resolution, from a new handle.
//   BM_DecodeClusters    reading, checking and decoding every cluster, one thread.
//                        items_per_second: nodes.
// Rates are per second of processor time, of all threads.
// Each checks its answer: counts against the record, the mesh against the statistics.
#include <benchmark/benchmark.h>

#include "bench/internal/workload.h"
#include "query/cluster_cache.h"

namespace mtdb {
namespace {

constexpr uint64_t kTriangles = 1000000;

const BenchStore& Store() {
  static BenchStore store;
  static const ObjectRecord kRecord =
      store.Build("sculpture", Sculpture(kTriangles), BuildOptions{});
  MTDB_CHECK(kRecord.triangles == Sculpture(kTriangles).triangles.size(), "all is stored");
  return store;
}

// Around a vertex of the surface, of a side that holds about 1 % of the triangles.
Query BoxQuery(const ObjectRecord& record) {
  const Vec3d centre = Sculpture(kTriangles).positions[Sculpture(kTriangles).positions.size() / 3];
  const double half = 0.045 * record.diagonal();
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

ExtractStats Extract(benchmark::State& state, const Surface& surface, const Query& query) {
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

void BM_WarmUniform(benchmark::State& state) {
  const std::shared_ptr<Surface> surface = Store().OpenSurface("sculpture");
  Query query;
  query.max_triangles = kTriangles * static_cast<uint64_t>(state.range(0)) / 1000;
  // The threshold that this budget stands for: thresholds are the common query.
  const ExtractStats budget = Extract(state, *surface, query);
  query.max_triangles.reset();
  query.threshold = ConstantThreshold(budget.error_bound - surface->record().grid.cell_error());
  ExtractStats stats = Extract(state, *surface, query);
  for (auto _ : state) stats = Extract(state, *surface, query);
  if (stats.clusters_read != 0) state.SkipWithError("not warm");
  Deliver(state, stats);
}

void BM_WarmBox(benchmark::State& state) {
  const std::shared_ptr<Surface> surface = Store().OpenSurface("sculpture");
  const Query query = BoxQuery(surface->record());
  ExtractStats stats = Extract(state, *surface, query);
  for (auto _ : state) stats = Extract(state, *surface, query);
  Query clipped = query;
  clipped.clip = true;
  const ExtractStats inside = Extract(state, *surface, clipped);
  Deliver(state, stats);
  state.counters["inside"] = static_cast<double>(inside.triangles);
  state.counters["outside_percent"] = 100.0 *
                                      static_cast<double>(stats.triangles - inside.triangles) /
                                      static_cast<double>(inside.triangles);
}

void BM_ColdBox(benchmark::State& state) {
  Store();
  ExtractStats stats;
  for (auto _ : state) {
    const std::shared_ptr<Surface> surface = Store().OpenSurface("sculpture");
    stats = Extract(state, *surface, BoxQuery(surface->record()));
  }
  if (stats.clusters_read == 0) state.SkipWithError("not cold");
  Deliver(state, stats);
  state.counters["clusters_read"] = static_cast<double>(stats.clusters_read);
  state.counters["clusters_total"] = static_cast<double>(stats.clusters_total);
  state.counters["kilobytes_read"] = static_cast<double>(stats.bytes_read) / 1e3;
}

void BM_StreamFull(benchmark::State& state) {
  Store();
  ExtractStats stats;
  for (auto _ : state) {
    stats = Extract(state, *Store().OpenSurface("sculpture"), Query{});
  }
  if (stats.triangles != Sculpture(kTriangles).triangles.size()) {
    state.SkipWithError("not the whole surface");
  }
  Deliver(state, stats);
}

void BM_DecodeClusters(benchmark::State& state) {
  Store();
  uint64_t nodes = 0;
  for (auto _ : state) {
    const std::shared_ptr<Surface> surface = Store().OpenSurface("sculpture");
    const ClusterIndex& index = surface->index();
    LoadStats stats;
    nodes = 0;
    for (UnitId unit = UnitCount(index); unit-- > 0;) {  // coarsest first: parents are there
      const LoadedUnitPtr loaded = surface->cache().Get(unit, &stats).value();
      nodes += loaded->nodes();
    }
    if (nodes != surface->record().nodes) state.SkipWithError("not every node was decoded");
  }
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(nodes));
}

BENCHMARK(BM_WarmUniform)
    ->ArgName("per_mille")
    ->Arg(10)
    ->Arg(100)
    ->Arg(500)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_WarmBox)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ColdBox)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_StreamFull)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);
BENCHMARK(BM_DecodeClusters)->MeasureProcessCPUTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mtdb

BENCHMARK_MAIN();
