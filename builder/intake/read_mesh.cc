// SPDX-License-Identifier: Apache-2.0
#include "builder/intake/read_mesh.h"

#include <algorithm>
#include <thread>

#include "builder/intake/attribute_sink.h"
#include "builder/intake/check_options.h"

namespace mtdb::internal {

Result<MeshSurvey> ReadMesh(const MeshProducer& produce, const BuildOptions& options,
                            InputSpool* input, MemoryPlan* plan) {
  MTDB_RETURN_IF_ERROR(CheckBuildOptions(options));
  if (options.weld) {
    input->Weld(*options.weld);
  } else if (!options.keep_apart && !options.terrain) {
    input->JoinSeams();
  }
  if (options.texture_step) input->KeepTextureStep();
  AttributeSink attributes(&options, input, [&](const MeshHeader& header) {
    const unsigned threads =
        options.threads != 0 ? options.threads : std::max(1u, std::thread::hardware_concurrency());
    MTDB_ASSIGN_OR_RETURN(*plan, PlanMemory(options, threads, header.attributes, header.textured));
    input->SetMemory(plan->spool_bytes / 4);
    return Status::Ok();
  });
  MTDB_RETURN_IF_ERROR(produce(attributes));
  MeshSurvey survey;
  survey.header = input->header();
  survey.vertices = input->vertices();
  survey.welded_vertices = input->welded_vertices();
  survey.equal_vertices = input->equal_vertices();
  survey.attributes_differ = input->attributes_differ();
  survey.triangles = input->report().triangles;
  survey.kept_triangles = input->triangles();
  survey.bounds = input->bounds();
  survey.temporary_bytes =
      TemporaryBytes(options, input->triangles(), CornerRowBytes(*input), plan->spool_bytes);
  return survey;
}

}  // namespace mtdb::internal
