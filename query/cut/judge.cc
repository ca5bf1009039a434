// SPDX-License-Identifier: Apache-2.0
#include "query/cut/judge.h"

#include <algorithm>
#include <span>

namespace mtdb::internal {

int Judge::LevelOf(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code) const {
  if (pixel() == nullptr) {
    return Refused(unit, slot, creator, code) ? levels().LevelOf(code) : Levels::kNone;
  }
  const double bound = Bound(code);
  const Triangle3d t = Corners(unit, slot, creator);
  if (!Active(t, bound) || !meter_->Spend(1)) return Levels::kNone;
  const double size = pixel()->Min(t, bound);
  const double permitted =
      pixels() ? std::max(*pixels() * size, rounding()) : threshold()->Min(t, bound);
  if (bound <= permitted) return Levels::kNone;
  return bound <= rounding() ? 0 : levels().LevelOf(bound, size);
}

bool Judge::RefusesAny(const LoadedUnit& unit, NodeIndex node) const {
  const uint8_t code = unit.cluster.error_codes[node];
  const std::span<const LocalNumber> hole = unit.cluster.hole(node);
  return std::any_of(hole.begin(), hole.end(), [&](uint32_t slot) {
    return Refused(unit, slot, by_code() ? 0 : unit.creator(slot), code);
  });
}

Activity Judge::ActivityIn(const Box3d& box, double bound) const {
  if (!meter_->Spend(1)) return Activity::kNone;
  if (whole() || region()->BoxCovers(box, 0)) return Activity::kAll;
  return region()->BoxWithin(box, bound) ? Activity::kSome : Activity::kNone;
}

Judge::Codes Judge::CodesIn(const Box3d& box, uint8_t largest) const {
  if (constant()) return {valid_code(), valid_code()};
  const ErrorRange asked = RangeIn(box, Bound(largest));
  const auto last_below = [&](double value) {
    return static_cast<int>(std::upper_bound(bounds().begin(), bounds().end(), value) -
                            bounds().begin()) -
           1;
  };
  return {last_below(asked.low), last_below(asked.high)};
}

Judge::Where Judge::WhereIs(const Box3d& box, double bound) const {
  if (whole()) return {Activity::kAll};
  if (!meter_->Spend(kDepthSteps)) return {Activity::kNone, 0};
  const double depth = region()->Depth(box);
  if (depth > 0) return {Activity::kAll, depth};
  if (depth < -bound) return {Activity::kNone, -depth - bound};
  return {ActivityIn(box, bound), 0};
}

Triangle3d Judge::Corners(const LoadedUnit& unit, uint32_t slot, NodeIndex creator) const {
  const std::array<uint32_t, 3> corners = unit.corners(slot, creator);
  const LocalPositions& positions = unit.positions();
  return {grid_.Position(positions[corners[0]]), grid_.Position(positions[corners[1]]),
          grid_.Position(positions[corners[2]])};
}

double Judge::Reach(UnitId unit) const {
  return Bound(std::max(index_.unit(unit).error_code_max, index_.error_code_below(unit)));
}

}  // namespace mtdb::internal
