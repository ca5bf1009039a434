// SPDX-License-Identifier: Apache-2.0
// BuildObject: from a triangle mesh to the Multi-Triangulation in a store. Start here.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "builder/build_options.h"
#include "builder/journal_info.h"
#include "builder/mesh_survey.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "store/object_record.h"
#include "store/object_writer.h"

namespace mtdb {

// What a stage took. This is not in the record, which does not depend on the machine's speed.
struct StageCost {
  std::string stage;       // "read", "join", "texture", "round 1", ..., "root", "publish"
  double seconds = 0;      // wall
  double cpu_seconds = 0;  // of all threads
  uint64_t tmp_bytes = 0;  // largest size of the temporary files at the stage's reports
};
struct BuildReport {
  std::vector<StageCost> stages;
  MeshSurvey survey;
  // Of images of the texture that could not be kept: a line for each that says why.
  std::vector<std::string> texture_notes;
  bool journal_left = false;  // the build failed, and the same one with `resume` goes on from there
};

// Builds the Multi-Triangulation of the mesh that `input` produces, and publishes it through
// `writer`. The record's InputReport counts what the mesh has that cannot be kept. Out of core: no
// step holds the whole mesh, except that the root is held as a whole. Deterministic: the same mesh
// and options give the same keys and values. `report`, when given, says where the time went.
//
// Errors: kBadInput (no triangles; coordinates that are not finite, or do not fit float32 when
// lossless; indices out of range; attributes that do not fit their step), kInvalidArgument (wrong
// options, or such as name an attribute that the input does not have, or a grid on which most
// triangles have no area, which is kBadInput when no grid suits the mesh; the journal of another
// build), kNoSpace and kIoError (temporary files; kNoSpace also when memory runs out),
// kBudgetExceeded (memory_bytes is too little for the attributes, the vertices or the root, and the
// message says how much is needed; or max_tmp_bytes is reached), and those of `input` and `writer`.
Result<ObjectRecord> BuildObject(const MeshProducer& input, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress = {},
                                 BuildReport* report = nullptr);
Result<ObjectRecord> BuildObject(const TriangleMesh& mesh, const BuildOptions& options,
                                 ObjectWriter& writer, const ProgressCallback& progress = {});

}  // namespace mtdb
