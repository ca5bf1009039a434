// SPDX-License-Identifier: Apache-2.0
// RemoveCrumbs: small parts of a tile's surface vanish as a whole.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "builder/disk/tile.h"
#include "store/base/grid.h"

namespace mtdb::internal {

struct CrumbLimits {
  double error = 0;  // work units; what is farther away stays
  // Per triangle of the tile: it is one of the surface that errors are measured against. Empty: all
  // are, and fans may get new numbers.
  std::span<const uint8_t> own;
  bool fresh() const { return own.empty(); }
};

// What vanishing small parts change of the numbers of the surface's parts.
struct CrumbCounts {
  uint64_t components = 0;    // that are gone
  uint64_t border_loops = 0;  // likewise
};

// A crumb is a part of the surface between creases, of at most kMostCrumbTriangles, that lies in
// the tile with all that is at its vertices: a component, or what hangs on other parts by edges and
// points. Its triggers are triangles beside it that have all edges and points by which it hangs;
// of a component, the nearest one. No point of a triangle is farther from another triangle than the
// farthest of its corners. A part that has a trigger of another crumb stays, and one that closes a
// surface.
//
// A trigger is a triangle of the surface that errors are measured against.
//
// Takes the crumbs out of the tile, and raises the errors and heights of their triggers. What is
// left at their vertices learns that they are gone: orders of edges, fans, what stays for ever.
// Deterministic.
std::vector<Crumb> RemoveCrumbs(const Grid& grid, const CrumbLimits& limits, TriangleBlock& tile,
                                CrumbCounts* counts);

// Whether so much of a tile may be crumbs that it is better measured against itself, even though
// errors add up: where it is not, few of them have triggers, and no sheets join.
bool HasManyCrumbs(std::span<const TileTriangle> tile);

// Edges that were creases and have two triangles left, which lie on one sheet, are creases no more
// where both ends are whole: fans join. Of a tile that is the surface itself.
void JoinSheets(std::vector<TileTriangle>& tile);

}  // namespace mtdb::internal
