// SPDX-License-Identifier: Apache-2.0
// TerrainPatch: what a cut of a terrain has over a rectangle of the plane.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "query/surface.h"
#include "query/terrain/overlay.h"

namespace mtdb::internal {

struct TerrainPatch {
  std::vector<Triangle3d> triangles;  // those that meet the rectangle, and perhaps more beside it
  double error = 0;                   // no height is farther from the terrain's than this
  // The terrain may reach where the cut does not: by the cut, nothing is known there, but that
  // heights are between these.
  bool may_cover_more = false;
  double least_height = 0, largest_height = 0;
};

// One thread.
class TerrainSide {
 public:
  struct Reading {
    uint64_t triangles = 0, clusters = 0, bytes = 0;
  };

  TerrainSide(const Surface& surface, bool as_stored, QueryControl* control)
      : surface_(surface), as_stored_(as_stored), control_(control) {}

  const ObjectRecord& record() const { return surface_.record(); }
  // Of the coarsest cut, and of the full resolution.
  double largest_error() const;
  double least_error() const;
  // Of the cut with errors of at most `threshold` over the rectangle; negative: at full resolution.
  // Nothing when that has more than `most` triangles.
  Result<std::optional<TerrainPatch>> Take(const PlaneWindow& window, double threshold,
                                           uint64_t most);
  const Reading& reading() const { return reading_; }

 private:
  double ErrorOf(double bound) const;

  const Surface& surface_;
  const bool as_stored_;
  QueryControl* const control_;
  Reading reading_;
};

}  // namespace mtdb::internal
