#include "builder/mesh_survey.h"

#include <algorithm>
#include <cstring>
#include <numeric>
#include <thread>
#include <vector>

#include "builder/internal/attribute_sink.h"
#include "builder/internal/check_options.h"
#include "builder/internal/grid_choice.h"
#include "builder/internal/input_spool.h"
#include "builder/internal/memory_plan.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

// Vertices that triangles join, as sets of a forest.
Result<uint64_t> CountComponents(const InputSpool& input) {
  std::vector<uint32_t> parent(input.vertices());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  std::vector<bool> used(input.vertices(), false);
  uint64_t count = 0;
  SpoolReader reader(&input.triangle_spool());
  for (uint64_t left = input.triangles(); left > 0; --left) {
    const std::byte* bytes = reader.Next(InputSpool::kTriangleBytes);
    if (bytes == nullptr) return reader.status();
    std::array<uint32_t, 3> t;
    std::memcpy(t.data(), bytes, sizeof(t));
    for (const uint32_t v : t) {
      count += !used[v];
      used[v] = true;
      const uint32_t a = root(t[0]);
      const uint32_t b = root(v);
      if (a == b) continue;
      --count;
      parent[std::max(a, b)] = std::min(a, b);
    }
  }
  return count;
}

Result<MeshSurvey> Survey(const MeshProducer& produce, const BuildOptions& options) {
  MTDB_RETURN_IF_ERROR(CheckBuildOptions(options));
  SpoolSpace space;
  space.directory = options.tmp_directory;
  InputSpool input(&space, 0, options.mode == PositionMode::kLossless);
  if (options.weld) input.Weld(*options.weld);
  MemoryPlan plan;
  AttributeSink attributes(&options, &input, [&](const MeshHeader& header) {
    const unsigned threads =
        options.threads != 0 ? options.threads : std::max(1u, std::thread::hardware_concurrency());
    MTDB_ASSIGN_OR_RETURN(plan, PlanMemory(options, threads, header.attributes));
    input.SetMemory(plan.spool_bytes / 4);
    return Status::Ok();
  });
  MTDB_RETURN_IF_ERROR(produce(attributes));
  MeshSurvey survey = SurveyOf(input);
  survey.temporary_bytes =
      TemporaryBytes(options, input.triangles(), input.row_bytes(), plan.spool_bytes);
  MTDB_RETURN_IF_ERROR(ChooseGrid(input, options, &space, plan.spool_bytes / 2, &survey));
  survey.store_bytes = EstimateStoreBytes(survey);
  if (input.vertices() * sizeof(uint32_t) <= plan.spool_bytes / 2) {
    MTDB_ASSIGN_OR_RETURN(survey.components, CountComponents(input));
  }
  return survey;
}

}  // namespace

Result<MeshSurvey> SurveyMesh(const MeshProducer& input, const BuildOptions& options) {
  return CatchOutOfMemory([&] { return Survey(input, options); });
}

}  // namespace mtdb
