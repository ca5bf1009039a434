// SPDX-License-Identifier: Apache-2.0
// CellChange: what two cuts tell of a rectangle of the plane.
#pragma once

#include <cstdint>

#include "query/height_change.h"
#include "query/terrain/overlay.h"
#include "query/terrain/terrain_patch.h"

namespace mtdb::internal {

// The largest difference in one direction: at least `low` at the point, at most `high`; both may be
// below 0.
struct CellExtreme {
  double low, high;
  Vec3d point;
};

// Of the terrains, not of the cuts: errors and rounding are counted.
struct CellChange {
  PlaneWindow window;
  bool common = false;     // both may cover some of it; else there are no extremes
  CellExtreme rise, fall;  // of B over A, and of A over B
  ValueInterval fill, cut, net;
  ValueInterval area_both, area_a, area_b;  // as in HeightChange
  uint64_t triangles = 0;                   // of both cuts
};

CellChange MeasureCell(const PlaneWindow& window, const TerrainPatch& a, const TerrainPatch& b);

}  // namespace mtdb::internal
