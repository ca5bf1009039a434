// SPDX-License-Identifier: Apache-2.0
#include "builder/holes/delaunay_filling.h"

#include <array>
#include <utility>

#include "store/base/lattice_polygon.h"

namespace mtdb::internal {

// A ring edge is an edge of the Delaunay triangulation of what is left, so that no point beyond it
// is ever the apex of an edge; but for edges that are the border, or lie at one. There the first
// try may fail, and the second one asks what an edge sees.
bool DelaunayFilling::Fill(const Hole& hole, Hole::Triangles& triangles) const {
  if (hole.folded) return false;
  std::array<LatticePoint, Hole::kMaxRing> room;
  for (uint32_t i = 0; i < hole.k; ++i) {
    room[i] = {static_cast<int64_t>(hole.positions[i].x),
               static_cast<int64_t>(hole.positions[i].y)};
  }
  const std::span<const LatticePoint> points(room.data(), hole.k);
  std::array<std::pair<uint32_t, uint32_t>, Hole::kMaxRing> stack;
  for (const bool careful : {false, true}) {
    uint32_t count = 0;
    const auto add = [&](uint32_t i, uint32_t m, uint32_t j) {
      triangles[count++] = {static_cast<uint8_t>(i), static_cast<uint8_t>(m),
                            static_cast<uint8_t>(j)};
    };
    if (TriangulatePolygon(points, careful, stack, add)) return true;
  }
  return false;
}

}  // namespace mtdb::internal
