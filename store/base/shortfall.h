// SPDX-License-Identifier: Apache-2.0
// Shortfall: where an answer is farther from the input than its query asks.
#pragma once

#include <cstdint>

#include "store/base/geometry.h"

namespace mtdb {

// Tells of the triangles of an answer whose bound is above the threshold around them. An answer has
// such triangles when vertices were rounded by more than the threshold, at ingest or by the output
// file, or when a budget ended the refinement.
struct Shortfall {
  uint64_t triangles = 0;  // how many they are; 0: the answer is what was asked for
  double excess = 0;       // the largest of (bound - threshold there), model units
  Box3d bounds;            // around these triangles, model units
  bool any() const { return triangles > 0; }
  friend bool operator==(const Shortfall&, const Shortfall&) = default;
};

}  // namespace mtdb
