// SPDX-License-Identifier: Apache-2.0
// The integral of what is positive of a linear function, over a triangle.
#pragma once

#include <algorithm>
#include <array>

namespace mtdb::internal {

// Of max(0, f), where f is linear, has these values at the corners, and the triangle this area.
// Exact but for rounding: where f changes its sign, what is cut off is a triangle, too.
inline double PositivePart(std::array<double, 3> f, double area) {
  std::sort(f.begin(), f.end());
  const double whole = area * (f[0] + f[1] + f[2]) / 3;
  if (f[0] >= 0) return whole;
  if (f[2] <= 0) return 0;
  if (f[1] <= 0) return area * f[2] * (f[2] / (f[2] - f[0])) * (f[2] / (f[2] - f[1])) / 3;
  // The negative part is a triangle at the least corner.
  const double below = area * f[0] * (f[0] / (f[0] - f[1])) * (f[0] / (f[0] - f[2])) / 3;
  return std::max(0.0, whole - below);
}

}  // namespace mtdb::internal
