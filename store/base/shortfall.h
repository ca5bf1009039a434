// Shortfall: where an answer is farther from the input than its query asks.
#pragma once

#include <cstdint>

#include "store/base/geometry.h"

namespace mtdb {

// Of the triangles of an answer whose bound is above the threshold around them. There are some
// where vertices were rounded by more than the threshold when the object was ingested, and where a
// budget ended the refinement.
struct Shortfall {
  uint64_t triangles = 0;  // 0: the answer is what was asked for
  double excess = 0;       // model units: the largest of their bounds less the threshold there
  Box3d bounds;            // model units, around them
  bool any() const { return triangles > 0; }
  friend bool operator==(const Shortfall&, const Shortfall&) = default;
};

}  // namespace mtdb
