// SPDX-License-Identifier: Apache-2.0
// RoundLevel: the error at which the tiles of a round end.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "builder/decimate/decimator.h"
#include "builder/disk/tile.h"
#include "store/base/grid.h"

namespace mtdb::internal {

// Tiles of a round end at one error, so that smooth places are left with fewer triangles than rough
// ones, and seams, which are denser than the rest, are caught up with in the next round. It is
// chosen such that rounds leave about 1 / reduction of their triangles: the first from a sample of
// the input, the others from how many triangles the rounds before have left. A tile is reduced by
// at least the root of `reduction`, and by its square at most, whatever its errors.
//
// Deterministic: depends on the options and on the order of the input's triangles. Single thread.
class RoundLevel {
 public:
  // `triangles` of the input.
  RoundLevel(uint64_t triangles, uint32_t reduction, uint32_t degree_limit);

  // Of the input, with its code on the first round's curve. Keeps triangles of whole cells of the
  // curve, some kSampleTriangles.
  void Sample(const TileTriangle& triangle, uint64_t code);
  // After the last Sample: sets the first round's level. Errors are in work units.
  void Begin(TileDecimator& decimator, const Grid& grid, double largest_error);
  // A round has left so many triangles; `hindered`: since seams locked most of them, and the level
  // was not reached.
  void Next(uint64_t left, bool hindered = false);

  // Where removals of a tile of the round end; `alone` when it holds the round's whole mesh.
  RemovalLimits Limits(size_t tile_triangles, bool alone) const;
  double error() const { return error_; }
  // The largest part of a tile's triangles that a round leaves, where vertices can be removed.
  static double MostLeft(double reduction);

 private:
  static constexpr uint64_t kSampleTriangles = 32768;

  double reduction_;
  uint32_t degree_limit_;
  int cell_shift_ = 0;
  uint64_t chosen_ = 0;  // cells whose hash is at most this are in the sample
  std::vector<TileTriangle> sample_;
  double largest_error_ = 0;
  double error_ = 0;
  double wanted_;  // triangles after the round
};

}  // namespace mtdb::internal
