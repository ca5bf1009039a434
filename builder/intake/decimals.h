// SPDX-License-Identifier: Apache-2.0
// Decimals: with how many decimals after the point a mesh's coordinates are written.
#pragma once

#include <array>
#include <cmath>
#include <optional>

#include "store/base/geometry.h"

namespace mtdb::internal {

// Sees all positions, and knows of each axis the least number of decimals that gives its
// coordinates. Float32 values count as the decimals that they were rounded from.
class Decimals {
 public:
  static constexpr int kMost = 9;

  void Add(Vec3d p, bool is_single) {
    for (int axis = 0; axis < 3; ++axis)
      AddTo(&axes_[static_cast<size_t>(axis)], p[axis], is_single);
  }
  // 10^-decimals of the axis; none when kMost do not suffice.
  std::optional<double> unit(int axis) const {
    const Axis& a = axes_[static_cast<size_t>(axis)];
    return a.decimals > kMost ? std::nullopt : std::optional(1 / a.power);
  }

 private:
  struct Axis {
    int decimals = 0;
    double power = 1;  // 10^decimals
  };
  static void AddTo(Axis* axis, double x, bool is_single) {
    while (axis->decimals <= kMost && !IsMultiple(x, axis->power, is_single)) {
      ++axis->decimals;
      axis->power *= 10;
    }
  }
  // A whole number below 2^53 divided by a power of ten is rounded as a reader rounds its text.
  static bool IsMultiple(double x, double power, bool is_single) {
    const double whole = std::nearbyint(x * power);
    if (!(std::abs(whole) < 0x1p53)) return false;
    const double nearest = whole / power;
    return nearest == x || (is_single && static_cast<float>(nearest) == static_cast<float>(x));
  }

  std::array<Axis, 3> axes_;
};

}  // namespace mtdb::internal
