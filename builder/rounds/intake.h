// SPDX-License-Identifier: Apache-2.0
// TakeIn: the first phase of a build, from what a user gives to the mesh of round 1.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "builder/build_options.h"
#include "builder/decimate/decimator.h"
#include "builder/disk/triangle_sorter.h"
#include "builder/intake/memory_plan.h"
#include "builder/measure/filling_measure.h"
#include "builder/mesh_survey.h"
#include "builder/rounds/build_context.h"
#include "builder/tiles/round_level.h"
#include "builder/tiles/tiling.h"
#include "builder/write/journal.h"
#include "store/base/status.h"
#include "store/base/texture.h"
#include "store/object_record.h"

namespace mtdb::internal {

struct IntakeResult {
  MeshSurvey survey;
  MemoryPlan plan;
  ObjectRecord record;                // what the input says of the object
  std::optional<BorderPlane> border;  // of a terrain whose border is simplified
  CurveSpace curves;                  // of rounds from the second on
  RoundCurve curve;                   // of the first, along which the triangles come
  RoundLevel level;                   // likewise
  std::unique_ptr<TriangleSorter> triangles;
  JournalKey journal_key;
  std::vector<Texture> textures;  // the input's
};

// Reads the mesh, chooses its grid, classifies its edges and vertices, and sorts its triangles.
// `decimator` guesses errors for the first round's level. Errors: see BuildObject.
Result<IntakeResult> TakeIn(const MeshProducer& produce, const BuildContext& build,
                            TileDecimator& decimator);

}  // namespace mtdb::internal
