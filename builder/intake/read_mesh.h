// SPDX-License-Identifier: Apache-2.0
// ReadMesh: how a mesh comes in, to be built or only surveyed.
#pragma once

#include "builder/intake/input_spool.h"
#include "builder/intake/memory_plan.h"
#include "builder/mesh_survey.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Checks the options, and takes the mesh into `input` as they want it: welded, its attributes
// rounded. Sets `plan` before the first vertex comes. Returns what is known of the mesh before its
// grid is chosen.
Result<MeshSurvey> ReadMesh(const MeshProducer& produce, const BuildOptions& options,
                            InputSpool* input, MemoryPlan* plan);

}  // namespace mtdb::internal
