// SPDX-License-Identifier: Apache-2.0
// Side: one of two surfaces that are compared: parts of its cuts, in common coordinates.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "query/compare/doubt.h"
#include "query/compare/placement.h"
#include "query/surface.h"

namespace mtdb::internal {

// Triangles of a cut. Each point of them has a point of the compared surface within `bound`.
struct Patch {
  std::vector<Triangle3d> triangles;
  double bound = 0;
};

// All lengths are in common coordinates. One thread.
class Side {
 public:
  struct Reading {
    uint64_t clusters = 0;
    uint64_t bytes = 0;
  };

  Side(const Surface& surface, const Placement& placement, bool as_stored, QueryControl* control);

  const Surface& surface() const { return surface_; }
  // Around the surface.
  const Box3d& bounds() const { return bounds_; }
  // Of the coarsest cut, and of the full resolution.
  double largest_bound() const { return BoundOf(surface_.record().error_code_max); }
  double least_bound() const { return BoundOf(0); }
  bool empty() const { return surface_.record().triangles == 0; }

  // Of the cut with bounds of at most `threshold` where anything asks (negative: at full
  // resolution), a part that each point of the surface has a counterpart in that is at most `by`
  // away from the boxes; null: all of the cut. Nothing when that has more than `most` triangles.
  // The bound may be larger where rounding was.
  Result<std::optional<Patch>> Take(const BoxSetPtr& boxes, double by, double threshold,
                                    uint64_t most, Reading* reading) const;

 private:
  double BoundOf(uint8_t code) const;
  double Common(double own_bound) const;
  RegionPtr OwnRegion(const BoxSetPtr& boxes, double by) const;

  const Surface& surface_;
  const Placement placement_;
  const bool as_stored_;
  QueryControl* const control_;
  Box3d bounds_;
};

}  // namespace mtdb::internal
