// SPDX-License-Identifier: Apache-2.0
// RunRound: a round of the build, from its mesh to the next one's.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "builder/decimate/decimator.h"
#include "builder/disk/triangle_sorter.h"
#include "builder/intake/memory_plan.h"
#include "builder/measure/tile_surface.h"
#include "builder/rounds/build_context.h"
#include "builder/rounds/surface_window.h"
#include "builder/rounds/tile_job.h"
#include "builder/tiles/round_level.h"
#include "builder/tiles/tiling.h"
#include "builder/write/journal.h"
#include "store/object_record.h"
#include "store/object_writer.h"

namespace mtdb::internal {

// What all rounds of a build work with.
struct RoundTools {
  const BuildContext& build;
  MemoryPlan plan;
  TileSetting setting;
  CurveSpace curves;
  std::span<const std::unique_ptr<TileDecimator>> decimators;  // of the threads
  ObjectWriter& writer;
  Journal* journal = nullptr;  // null: none
};

struct RoundInput {
  uint32_t round = 1;
  TriangleSorter& triangles;
  const RoundCurve& curve;       // along which they come
  const RoundCurve& next_curve;  // along which those that it leaves will
  const RoundLevel& level;
  const SurfaceWindow& surfaces;
  double done = 0, share = 0;  // of the whole build: before the round, and in it
};

struct RoundResult {
  RoundReport report;
  uint64_t seam_vertices = 0;  // that only seams locked
  CrumbCounts vanished;
  uint32_t depth = 0;                         // longest path of nodes from one of it to the drain
  uint32_t max_degree = 0;                    // of its nodes
  std::unique_ptr<TriangleSorter> triangles;  // that it leaves
  std::unique_ptr<SurfaceSpool> surfaces;     // that later rounds may go on from
};

// Simplifies the tiles by several threads; takes their outcomes in the tiles' order, writes the
// clusters, and notes the outcomes in the journal, whose own come first.
Result<RoundResult> RunRound(const RoundTools& tools, const RoundInput& input);

// Sorts a round's mesh once more, along another curve. `progress`: at its beginning.
Result<std::unique_ptr<TriangleSorter>> SortAnew(const RoundTools& tools, TriangleSorter& from,
                                                 const RoundCurve& curve, BuildProgress progress);

}  // namespace mtdb::internal
