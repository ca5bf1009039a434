// SPDX-License-Identifier: Apache-2.0
#include "builder/rounds/surface_window.h"

#include <utility>

namespace mtdb::internal {

namespace {

// Rounds that are measured against one surface (docs/design.md, section 3): two, or, where it has
// no more triangles than a tile may have beneath it, as many as it takes to the root. A terrain's
// curves become too long for that.
constexpr uint32_t kRounds = 2;
constexpr uint32_t kTerrainRounds = 3;

}  // namespace

bool SurfaceWindow::IsLast(uint32_t begun) const {
  uint32_t rounds = is_terrain_ ? kTerrainRounds : kMostRounds;
  if (triangles_in_[begun - 1] > kMostSurface) rounds = kRounds;
  return round() + 1 >= begun + rounds;
}

Result<SurfaceBeneath> SurfaceWindow::Beneath(std::span<const TileTriangle> tile) const {
  SurfaceBeneath beneath;
  MTDB_ASSIGN_OR_RETURN(beneath.surface, GatherSurface(left_by_, tile));
  if (!IsWorthGoingOn(beneath.surface, is_terrain_)) beneath.surface = {};
  const uint32_t begun = beneath.surface.empty() ? round() : beneath.surface.round;
  beneath.goes_on_from = IsLast(begun) ? 0 : begun;
  return beneath;
}

SurfaceBeneath SurfaceWindow::Afresh() const { return {{}, IsLast(round()) ? 0 : round()}; }

void SurfaceWindow::End(std::unique_ptr<SurfaceSpool> left) {
  left_by_.push_back(std::move(left));
  if (IsLast(left_by_.front()->round())) left_by_.erase(left_by_.begin());
}

}  // namespace mtdb::internal
