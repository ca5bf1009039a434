// SPDX-License-Identifier: Apache-2.0
#include "builder/mesh_survey.h"

#include <array>
#include <vector>

#include "builder/disk/disjoint_sets.h"
#include "builder/intake/grid_choice.h"
#include "builder/intake/read_mesh.h"
#include "builder/surface/height_field.h"
#include "builder/surface/orient_sheets.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

// Vertices that triangles join.
Result<uint64_t> CountComponents(const InputMesh& input) {
  DisjointSets sets(input.vertices());
  std::vector<bool> used(input.vertices(), false);
  uint64_t count = 0;
  SpoolReader reader(&input.triangle_spool());
  for (uint64_t left = input.triangles(); left > 0; --left) {
    std::array<uint32_t, 3> t;
    if (!reader.Get(&t)) return reader.status();
    for (const uint32_t v : t) {
      count += !used[v];
      used[v] = true;
      count -= sets.Join(t[0], v);
    }
  }
  return count;
}

Result<SheetReport> LookAtSheets(const BuildOptions& options, const SpoolSpace* space,
                                 size_t memory_bytes, InputMesh* input) {
  if (options.orient) return OrientSheets(input, space, memory_bytes);
  return CountSheets(input->triangle_spool(), input->vertices(), space, memory_bytes);
}

Result<MeshSurvey> Survey(const MeshProducer& produce, const BuildOptions& options) {
  SpoolSpace space;
  space.directory = options.tmp_directory;
  space.max_bytes = options.max_tmp_bytes;
  InputSpool input(&space, 0, options.mode == PositionMode::kLossless);
  MemoryPlan plan;
  MTDB_ASSIGN_OR_RETURN(MeshSurvey survey, ReadMesh(produce, options, &input, &plan));
  MTDB_RETURN_IF_ERROR(ChooseGrid(input, options, &space, plan.spool_bytes / 2, &survey));
  if (input.vertices() * sizeof(uint32_t) <= plan.spool_bytes / 2) {
    MTDB_ASSIGN_OR_RETURN(survey.components, CountComponents(input));
  }
  const uint64_t memory = plan.spool_bytes;
  survey.oriented = options.orient;
  MTDB_ASSIGN_OR_RETURN(survey.sheets, LookAtSheets(options, &space, memory / 2, &input));
  if (options.height_field && survey.refusal.ok()) {
    MTDB_RETURN_IF_ERROR(MakeFacesLookUp(options, &space, memory / 2, &input, &survey).status());
    const JoinOptions join{&space, memory / 4, memory / 2, plan.threads};
    MTDB_RETURN_IF_ERROR(CheckHeights(input, survey.grid, join, memory / 4));
  }
  return survey;
}

}  // namespace

Result<MeshSurvey> SurveyMesh(const MeshProducer& input, const BuildOptions& options) {
  return CatchOutOfMemory([&] { return Survey(input, options); });
}

}  // namespace mtdb
