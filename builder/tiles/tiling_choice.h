// SPDX-License-Identifier: Apache-2.0
// TilingChoice: whether there is another round, and how its mesh is cut, given what seams held
// back.
#pragma once

#include <cstdint>

namespace mtdb::internal {

// Most rounds leave few vertices on seams of tiles. Of triangles that are long and thin all may be,
// where the mesh is larger than a window of the TileCutter, which cuts along the mesh. Then the
// next round's curve goes by owners (RoundCurve), which frees at least some vertices of every
// neighbourhood, until a window has the whole mesh, or a quarter of it is left.
class TilingChoice {
 public:
  struct Round {
    uint64_t triangles_in = 0, triangles_out = 0;
    uint64_t vertices = 0;       // before it
    uint64_t seam_vertices = 0;  // that only seams locked; once for each tile
  };
  explicit TilingChoice(uint64_t window_triangles) : window_triangles_(window_triangles) {}

  // False: this round was the last, since no tiling will let the next one remove much.
  bool Next(const Round& round);
  // For the curve of the round that comes.
  uint32_t owner_levels() const { return owner_levels_; }
  // Whether seams locked most vertices of the last round.
  bool was_hindered() const { return hindered_; }

 private:
  uint64_t window_triangles_;
  uint32_t owner_levels_ = 0;
  uint32_t finer_ = 0;       // levels, since owners did not help either
  uint32_t stalls_ = 0;      // rounds without progress, one after the other
  uint64_t centres_in_ = 0;  // triangles of the last round that was not cut by owners
  bool hindered_ = false;
};

}  // namespace mtdb::internal
