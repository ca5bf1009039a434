// SPDX-License-Identifier: Apache-2.0
// How fast a mesh becomes a store, and how large the store is.
//
//   build_bench [--benchmark_filter=...]
//
// Workloads, on generated sculptures of N triangles (closed, rough at all scales):
//   BM_Build/N/T             BuildObject with T threads. items_per_second: input triangles per
//                            second; per_core_second: per second of processor time; peak_mb:
//                            resident memory, input included; bits_per_vertex: of the stored pages.
//   BM_MeshoptQuarter/N      peer: meshopt_simplify to a quarter, about what one round does.
//   BM_CgalQuarter/N         peer: CGAL's Garland-Heckbert collapses to a quarter.
//   BM_DracoEncode/N         peer: the full resolution alone as a Draco file (16 bits, level 10).
// Each checks its answer: counts of what was built, the size of what was simplified.
#include <benchmark/benchmark.h>

#include "bench/internal/cgal_simplify.h"
#include "bench/internal/meshopt_simplify.h"
#include "bench/internal/workload.h"

namespace mtdb {
namespace {

uint64_t SizeOf(const benchmark::State& state) { return static_cast<uint64_t>(state.range(0)); }

void CountTriangles(benchmark::State& state, const TriangleMesh& mesh, double cpu_seconds) {
  const double triangles =
      static_cast<double>(state.iterations()) * static_cast<double>(mesh.triangles.size());
  state.SetItemsProcessed(static_cast<int64_t>(triangles));
  state.counters["per_core_second"] = triangles / cpu_seconds;
}

void BM_Build(benchmark::State& state) {
  const TriangleMesh& mesh = Sculpture(SizeOf(state));
  BuildOptions options;
  options.threads = static_cast<unsigned>(state.range(1));
  ObjectRecord record;
  double cpu = 0;
  ResetPeakMemory();
  for (auto _ : state) {
    state.PauseTiming();
    BenchStore store;
    state.ResumeTiming();
    const double begin = ProcessCpuSeconds();
    record = store.Build("sculpture", mesh, options);
    cpu += ProcessCpuSeconds() - begin;
  }
  if (record.triangles != mesh.triangles.size() || record.vertices != mesh.positions.size() ||
      record.nodes + record.root_vertices != record.vertices) {
    state.SkipWithError("the store does not hold the mesh");
  }
  CountTriangles(state, mesh, cpu);
  state.counters["peak_mb"] = static_cast<double>(PeakMemoryBytes()) / 1e6;
  state.counters["bits_per_vertex"] =
      8.0 * static_cast<double>(record.stored_bytes) / static_cast<double>(record.vertices);
}

void BM_MeshoptQuarter(benchmark::State& state) {
  const TriangleMesh& mesh = Sculpture(SizeOf(state));
  const MeshoptInput input(mesh);
  const uint64_t target = mesh.triangles.size() / 4;
  size_t left = 0;
  double cpu = 0;
  for (auto _ : state) {
    const double begin = ProcessCpuSeconds();
    left = SimplifyByMeshopt(input, target).size() / 3;
    cpu += ProcessCpuSeconds() - begin;
  }
  if (left == 0 || left > target + target / 20) state.SkipWithError("not simplified to a quarter");
  CountTriangles(state, mesh, cpu);
}

void BM_CgalQuarter(benchmark::State& state) {
  const TriangleMesh& mesh = Sculpture(SizeOf(state));
  const uint64_t target = mesh.triangles.size() / 4;
  uint64_t left = 0;
  double cpu = 0;
  for (auto _ : state) {
    const double begin = ProcessCpuSeconds();
    const auto result = SimplifyByCgal(mesh, target, CgalMethod::kGarlandHeckbert);
    cpu += ProcessCpuSeconds() - begin;
    left = result ? result->triangles.size() : 0;
  }
  if (left == 0 || left > target) state.SkipWithError("not simplified to a quarter");
  CountTriangles(state, mesh, cpu);
}

void BM_DracoEncode(benchmark::State& state) {
  const TriangleMesh& mesh = Sculpture(SizeOf(state));
  uint64_t bytes = 0;
  double cpu = 0;
  for (auto _ : state) {
    const double begin = ProcessCpuSeconds();
    bytes = DracoBytes(mesh, 16);
    cpu += ProcessCpuSeconds() - begin;
  }
  if (bytes == 0) state.SkipWithError("nothing was written");
  CountTriangles(state, mesh, cpu);
  state.counters["bits_per_vertex"] =
      8.0 * static_cast<double>(bytes) / static_cast<double>(mesh.positions.size());
}

BENCHMARK(BM_Build)
    ->ArgNames({"triangles", "threads"})
    ->ArgsProduct({{100000, 1000000}, {1, 2}})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_MeshoptQuarter)
    ->ArgName("triangles")
    ->Arg(100000)
    ->Arg(1000000)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_CgalQuarter)
    ->ArgName("triangles")
    ->Arg(100000)
    ->Arg(1000000)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_DracoEncode)
    ->ArgName("triangles")
    ->Arg(100000)
    ->Arg(1000000)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mtdb

BENCHMARK_MAIN();
