// SPDX-License-Identifier: Apache-2.0
// Tiling: a round's mesh in runs along a Hilbert curve.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "builder/internal/tile.h"
#include "store/base/grid.h"

namespace mtdb::internal {

// Maps points to a Hilbert curve that is shifted, reflected and turned anew in every round, so
// that no seam of one round's tiles is a seam of the next. Integers only, after one scaling.
class RoundCurve {
 public:
  // Along an axis on which the bounds have no extent, points may lie anywhere.
  RoundCurve(const Box3d& bounds, uint32_t round);
  // The code of a triangle's centre.
  uint64_t Code(const TileTriangle& triangle, const Grid& grid) const;
  std::vector<uint64_t> Codes(std::span<const TileTriangle> triangles, const Grid& grid) const;

 private:
  Vec3d min_;
  double scale_[3];
  uint32_t shift_[3];
  uint32_t mirror_[3];
  int axis_[3];
};

// The bounds of tile `tile` of `tiles` of equal size among `triangles`.
constexpr std::pair<uint64_t, uint64_t> TileRange(uint64_t triangles, uint64_t tiles,
                                                  uint64_t tile) {
  return {triangles * tile / tiles, triangles * (tile + 1) / tiles};
}

}  // namespace mtdb::internal
