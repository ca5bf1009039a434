// SPDX-License-Identifier: Apache-2.0
// SurfaceWindow: which rounds are measured against one surface, and what they leave for that.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "builder/disk/tile.h"
#include "builder/measure/tile_surface.h"
#include "store/base/status.h"

namespace mtdb::internal {

// What a tile's errors are measured against.
struct SurfaceBeneath {
  TileSurface surface;        // empty: the tile itself
  uint32_t goes_on_from = 0;  // the round that began with it; 0: the next round need not go on
};

// Work of one thread, but for what is const.
class SurfaceWindow {
 public:
  // Rounds that one surface serves at most.
  static constexpr uint32_t kMostRounds = 8;

  explicit SurfaceWindow(bool is_terrain) : is_terrain_(is_terrain) {}

  // Rounds follow each other: Begin, then any calls of what is const, then End.
  void Begin(uint64_t triangles) { triangles_in_.push_back(triangles); }
  void End(std::unique_ptr<SurfaceSpool> left);

  Result<SurfaceBeneath> Beneath(std::span<const TileTriangle> tile) const;
  // Of a tile that is measured against itself.
  SurfaceBeneath Afresh() const;

 private:
  uint32_t round() const { return static_cast<uint32_t>(triangles_in_.size()); }
  // Whether no round after this one is measured against the surface that `begun` began with.
  bool IsLast(uint32_t begun) const;

  bool is_terrain_;
  std::vector<uint64_t> triangles_in_;                  // of the rounds so far
  std::vector<std::unique_ptr<SurfaceSpool>> left_by_;  // rounds that later ones may go on from
};

}  // namespace mtdb::internal
