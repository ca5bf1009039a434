// SPDX-License-Identifier: Apache-2.0
// What regions allow for rounding, so that their answers err to the safe side.
#pragma once

#include <algorithm>
#include <cmath>

#include "store/base/geometry.h"

namespace mtdb::internal {

// Relative to the largest number that enters a question. Boxes get more, so that what is said of a
// box holds for the triangles inside.
constexpr double kTriangleRounding = 1e-13;
constexpr double kBoxRounding = 1e-12;

inline double LargestCoordinate(Vec3d p) {
  return std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)});
}

// `scale` is the largest coordinate of the region.
inline double Rounding(const Triangle3d& t, double distance, double scale) {
  return kTriangleRounding * std::max({LargestCoordinate(t[0]), LargestCoordinate(t[1]),
                                       LargestCoordinate(t[2]), distance, scale});
}
inline double Rounding(const Box3d& box, double distance, double scale) {
  return kBoxRounding *
         std::max({LargestCoordinate(box.min), LargestCoordinate(box.max), distance, scale});
}

inline Box3d Around(const Triangle3d& t) {
  Box3d box;
  for (const Vec3d& p : t) box.Add(p);
  return box;
}

inline Vec3d Corner(const Box3d& box, int i) {
  return {(i & 1) ? box.max.x : box.min.x, (i & 2) ? box.max.y : box.min.y,
          (i & 4) ? box.max.z : box.min.z};
}

}  // namespace mtdb::internal
