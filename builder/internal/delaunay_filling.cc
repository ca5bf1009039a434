// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/delaunay_filling.h"

#include <algorithm>
#include <array>
#include <utility>

namespace mtdb::internal {

namespace {

__extension__ using Wide = __int128;

// True when every difference is below 2^14.
bool IsNear(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const auto [least_x, most_x] = std::minmax({a.x, b.x, c.x, d.x});
  const auto [least_y, most_y] = std::minmax({a.y, b.y, c.y, d.y});
  return std::max(most_x - least_x, most_y - least_y) < (1 << 14);
}

LatticePoint At(const Hole& hole, uint32_t i) {
  return {static_cast<int64_t>(hole.positions[i].x), static_cast<int64_t>(hole.positions[i].y)};
}

// True when the ring positions i and m, and m and j, see each other within the polygon i .. j.
bool SeesApex(const std::array<LatticePoint, Hole::kMaxRing>& p, uint32_t i, uint32_t m,
              uint32_t j) {
  const auto sign = [](int64_t turn) { return (turn > 0) - (turn < 0); };
  const auto crosses = [&](uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    if (a == c || a == d || b == c || b == d) return false;
    return sign(Turn(p[a], p[b], p[c])) * sign(Turn(p[a], p[b], p[d])) <= 0 &&
           sign(Turn(p[c], p[d], p[a])) * sign(Turn(p[c], p[d], p[b])) <= 0;
  };
  for (uint32_t r = i; r < j; ++r) {
    if (crosses(i, m, r, r + 1) || crosses(m, j, r, r + 1)) return false;
  }
  for (uint32_t r = i + 1; r < j; ++r) {
    if (r == m) continue;
    if (Turn(p[i], p[m], p[r]) >= 0 && Turn(p[m], p[j], p[r]) >= 0 && Turn(p[j], p[i], p[r]) >= 0) {
      return false;
    }
  }
  return true;
}

// Of the ring positions between i and j, the one whose circle with them holds no other one; none:
// kNone32. `careful`: of those that the edge sees only.
uint32_t ApexOf(const std::array<LatticePoint, Hole::kMaxRing>& p, uint32_t i, uint32_t j,
                bool careful) {
  uint32_t apex = kNone32;
  for (uint32_t m = i + 1; m < j; ++m) {
    if (Turn(p[i], p[m], p[j]) <= 0) continue;
    if (careful && !SeesApex(p, i, m, j)) continue;
    if (apex == kNone32 || IsInCircle(p[i], p[apex], p[j], p[m])) apex = m;
  }
  return apex;
}

bool Triangulate(const Hole& hole, const std::array<LatticePoint, Hole::kMaxRing>& p, bool careful,
                 Hole::Triangles& triangles) {
  uint32_t count = 0;
  std::array<std::pair<uint32_t, uint32_t>, 2 * Hole::kMaxRing> stack;
  uint32_t depth = 0;
  stack[depth++] = {0, hole.k - 1};
  while (depth > 0) {
    const auto [i, j] = stack[--depth];
    if (j - i < 2) continue;
    const uint32_t m = ApexOf(p, i, j, careful);
    if (m == kNone32) return false;
    triangles[count++] = {static_cast<uint8_t>(i), static_cast<uint8_t>(m),
                          static_cast<uint8_t>(j)};
    stack[depth++] = {i, m};
    stack[depth++] = {m, j};
  }
  return true;
}

}  // namespace

bool IsInCircle(LatticePoint a, LatticePoint b, LatticePoint c, LatticePoint d) {
  const int sign =
      IsNear(a, b, c, d) ? CircleSign<int64_t>(a, b, c, d) : CircleSign<Wide>(a, b, c, d);
  if (sign != 0) return sign > 0;
  return TieIsInCircle(a, b, c, d);
}

// A ring edge is an edge of the Delaunay triangulation of what is left, so that no point beyond it
// is ever the apex of an edge; but for edges that are the border, or lie at one. There the first
// try may fail, and the second one asks what an edge sees.
bool DelaunayFilling::Fill(const Hole& hole, Hole::Triangles& triangles) const {
  if (hole.folded) return false;
  std::array<LatticePoint, Hole::kMaxRing> points;
  for (uint32_t i = 0; i < hole.k; ++i) points[i] = At(hole, i);
  return Triangulate(hole, points, false, triangles) || Triangulate(hole, points, true, triangles);
}

}  // namespace mtdb::internal
