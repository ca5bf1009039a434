// SPDX-License-Identifier: Apache-2.0
// Polygons of a lattice, triangulated by the Delaunay rule (codecs/FORMAT.md).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

#include "store/base/ids.h"
#include "store/base/in_circle.h"

namespace mtdb {

// True when the corners i and m, and m and j, see each other within the polygon i .. j.
inline bool SeesApex(std::span<const LatticePoint> p, uint32_t i, uint32_t m, uint32_t j) {
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

// Of the corners between i and j, the one whose circle with them holds no other one; none: kNone32.
// `careful`: of those that the edge sees only.
inline uint32_t ApexOf(std::span<const LatticePoint> p, uint32_t i, uint32_t j, bool careful) {
  uint32_t apex = kNone32;
  for (uint32_t m = i + 1; m < j; ++m) {
    if (Turn(p[i], p[m], p[j]) <= 0) continue;
    if (careful && !SeesApex(p, i, m, j)) continue;
    if (apex == kNone32 || IsInCircle(p[i], p[apex], p[j], p[m])) apex = m;
  }
  return apex;
}

// The Delaunay triangulation of a polygon's corners, constrained by its edges: calls
// add(i, m, j), i < m < j, for each triangle. Where each edge but the last is one of the Delaunay
// triangulation of all that lies around, no point beyond it is ever an apex; at borders this may be
// otherwise, and false be returned: then `careful` finds out. Takes the square of the number of
// corners; its cube when careful. `stack`: room for as many edges as there are corners.
template <typename Add>
bool TriangulatePolygon(std::span<const LatticePoint> p, bool careful,
                        std::span<std::pair<uint32_t, uint32_t>> stack, Add&& add) {
  size_t depth = 0;
  stack[depth++] = {0, static_cast<uint32_t>(p.size()) - 1};
  while (depth > 0) {
    const auto [i, j] = stack[--depth];
    if (j - i < 2) continue;
    const uint32_t m = ApexOf(p, i, j, careful);
    if (m == kNone32) return false;
    add(i, m, j);
    stack[depth++] = {i, m};
    stack[depth++] = {m, j};
  }
  return true;
}

}  // namespace mtdb
