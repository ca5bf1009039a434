// SPDX-License-Identifier: Apache-2.0
// What comparisons allow for rounding, so that intervals hold in real numbers.
#pragma once

#include <algorithm>
#include <cmath>

#include "store/base/geometry.h"

namespace mtdb::internal {

// Relative to the largest coordinate of both surfaces. A distance of two points, or of a point from
// a plane, is right up to some 2^-50 of it. Cutting a triangle into parts moves their corners by
// 2^-51 at each of at most 128 cuts.
constexpr double kOutward = 0x1p-43;

// Larger than a product or sum of a few numbers above 0 by more than its rounding.
constexpr double Up(double value) { return value * (1 + 0x1p-48); }

inline double LargestMagnitude(const Box3d& box) {
  double largest = 0;
  for (int i = 0; i < 3; ++i) {
    largest = std::max({largest, std::abs(box.min[i]), std::abs(box.max[i])});
  }
  return largest;
}

inline Box3d Grown(const Box3d& box, double by) {
  return {box.min - Vec3d{by, by, by}, box.max + Vec3d{by, by, by}};
}

}  // namespace mtdb::internal
