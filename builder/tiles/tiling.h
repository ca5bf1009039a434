// SPDX-License-Identifier: Apache-2.0
// Tiling: a round's mesh in runs along a Hilbert curve.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "builder/disk/tile.h"
#include "store/base/grid.h"

namespace mtdb::internal {

// Maps points to a Hilbert curve that is shifted, reflected and turned anew in every round, so
// that no seam of one round's tiles is a seam of the next. Integers only, after one scaling.
//
// Where triangles are long and thin, their centres may lie such that no vertex has all of its
// triangles in one run. So a curve may go by owners: space is cut into cells, by so many levels,
// which are ranked at random. A triangle belongs to the first of the cells that its corners are in,
// so that all triangles around the vertices of a cell that comes before its neighbours are in one
// run, however far the triangles reach.
class RoundCurve {
 public:
  // Along an axis on which the bounds have no extent, points may lie anywhere. `owner_levels`: 0,
  // or the cells are 2^-owner_levels of the curve's cube, which is twice as large as the mesh.
  RoundCurve(const Box3d& bounds, uint32_t round, uint32_t owner_levels = 0);
  // The code of a triangle: of its centre, or of its owner and then its centre.
  uint64_t Code(const TileTriangle& triangle, const Grid& grid) const;
  std::vector<uint64_t> Codes(std::span<const TileTriangle> triangles, const Grid& grid) const;

 private:
  uint64_t CodeAt(Vec3d place) const;
  uint64_t OwnerCode(const TileTriangle& triangle, const Grid& grid) const;

  Vec3d min_;
  double scale_[3];
  uint32_t shift_[3];
  uint32_t mirror_[3];
  int axis_[3];
  uint32_t owner_levels_;
  uint64_t ranks_;  // of cells: a seed
};

// The bounds of tile `tile` of `tiles` of equal size among `triangles`.
constexpr std::pair<uint64_t, uint64_t> TileRange(uint64_t triangles, uint64_t tiles,
                                                  uint64_t tile) {
  return {triangles * tile / tiles, triangles * (tile + 1) / tiles};
}

}  // namespace mtdb::internal
