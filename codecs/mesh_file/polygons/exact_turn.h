// SPDX-License-Identifier: Apache-2.0
// Which way three points of a plane turn, for coordinates in double.
#pragma once

namespace mtdb::internal {

struct PlanePoint {
  double x = 0, y = 0;
  friend bool operator==(PlanePoint, PlanePoint) = default;
};

// 1 when abc runs counter-clockwise, -1 when it runs clockwise, 0 when the points lie on a line.
// Exact (Shewchuk, Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric
// Predicates, 1997: a filter, then expansions), for coordinates that are 0 or of a magnitude from
// 2^-400 to 2^200.
int TurnOf(PlanePoint a, PlanePoint b, PlanePoint c);

}  // namespace mtdb::internal
