// SPDX-License-Identifier: Apache-2.0
// BuildContext: what every phase of a build works with.
#pragma once

#include <cstdint>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "builder/build_options.h"
#include "builder/decimate/up_finder.h"
#include "builder/disk/spool.h"
#include "builder/disk/triangle_sorter.h"
#include "builder/rounds/stage_clock.h"
#include "builder/tiles/tiling.h"
#include "store/base/grid.h"

namespace mtdb::internal {

inline bool IsTerrain(const BuildOptions& options) {
  return options.terrain.has_value() || options.height_field;
}

struct BuildContext {
  const BuildOptions& options;
  const SpoolSpace& space;
  StageClock& clock;
  UpFinder& up;
};

// Where the curves of rounds run.
struct CurveSpace {
  Grid grid;     // of tiles' positions: a raster's are the integers of its lattice
  Box3d bounds;  // of a terrain without heights, which have other units than places

  RoundCurve Curve(uint32_t round, uint32_t owner_levels = 0) const {
    return RoundCurve(bounds, round, owner_levels);
  }
};

// Gives free pages back to the system, where the C library has a way.
inline void ReturnFreedMemory() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

}  // namespace mtdb::internal
