// SPDX-License-Identifier: Apache-2.0
// The Delaunay rule of height fields (codecs/FORMAT.md): exact, with ties broken by a symbolic
// perturbation. The builder fills holes by it, and the codec derives them by it.
#pragma once

#include <algorithm>
#include <array>
#include <compare>
#include <cstdint>

namespace mtdb {

// A point of the lattice; differences are below 2^30.
struct LatticePoint {
  int64_t x = 0, y = 0;
  friend auto operator<=>(const LatticePoint&, const LatticePoint&) = default;  // x, then y
};

// Twice the area of abc: positive when it runs counter-clockwise. It has 62 bits.
inline int64_t Turn(LatticePoint a, LatticePoint b, LatticePoint c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

// The sign of the determinant of the circle test: positive when d lies inside the circle through
// a, b and c, which run counter-clockwise; 0 on it. It has 4 k + 4 bits when differences are below
// 2^k: an int64_t suffices for k = 14.
template <typename Number>
int CircleSign(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const auto row = [&](LatticePoint p) {
    const auto x = static_cast<Number>(p.x - d.x);
    const auto y = static_cast<Number>(p.y - d.y);
    return std::array<Number, 3>{x, y, x * x + y * y};
  };
  const auto [ax, ay, aw] = row(a);
  const auto [bx, by, bw] = row(b);
  const auto [cx, cy, cw] = row(c);
  const Number det = ax * (by * cw - bw * cy) - ay * (bx * cw - bw * cx) + aw * (bx * cy - by * cx);
  return det > 0 ? 1 : det < 0 ? -1 : 0;
}

// Of four different points on a circle, of which a, b and c run counter-clockwise: true when d
// counts as inside. It is as if each point were lifted a little off the paraboloid, the
// lexicographically largest by far the most. The derivative of the determinant by the lift of a
// point is the turn of the three others, which is not 0 on a circle; so the largest point decides
// (Devillers and Teillaud, Perturbations for Delaunay and weighted Delaunay 3D triangulations,
// 2011; here in the plane).
inline bool TieIsInCircle(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  if (a > b && a > c) return d < a && Turn(b, c, d) > 0;
  if (b > c) return d < b && Turn(c, a, d) > 0;
  return d < c && Turn(a, b, d) > 0;
}

// True when d lies inside the circle through a, b and c, which run counter-clockwise, all four
// different. Exact. Of four points on a circle the symbolic perturbation decides.
inline bool IsInCircle(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  __extension__ using Wide = __int128;
  const auto [least_x, most_x] = std::minmax({a.x, b.x, c.x, d.x});
  const auto [least_y, most_y] = std::minmax({a.y, b.y, c.y, d.y});
  const bool near = std::max(most_x - least_x, most_y - least_y) < (1 << 14);
  const int sign = near ? CircleSign<int64_t>(a, b, c, d) : CircleSign<Wide>(a, b, c, d);
  return sign != 0 ? sign > 0 : TieIsInCircle(a, b, c, d);
}

}  // namespace mtdb
