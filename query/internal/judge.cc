#include "query/internal/judge.h"

#include <algorithm>

namespace mtdb::internal {

Judge::Judge(const ClusterSource& source, double rounding)
    : index_(source.index()),
      grid_(source.record().grid),
      rounding_(rounding),
      bounds_(BoundsByCode(grid_, rounding)) {}

void Judge::SetQuery(const Query& query) {
  region_ = query.region == nullptr || query.region->whole() ? nullptr : query.region;
  if (threshold_ != nullptr && asked_ == query.threshold) return;
  threshold_ = Attainable(query.threshold, rounding_);
  asked_ = query.threshold;
  constant_ = threshold_->constant();
  valid_code_ = -1;
  while (constant_ && valid_code_ < 255 &&
         bounds_[static_cast<size_t>(valid_code_ + 1)] <= *constant_) {
    ++valid_code_;
  }
}

bool Judge::RefusesAny(const LoadedUnit& unit, NodeIndex node) const {
  const uint8_t code = unit.cluster.error_codes[node];
  const std::span<const uint32_t> hole = unit.cluster.hole(node);
  return std::any_of(hole.begin(), hole.end(), [&](uint32_t slot) {
    return Refused(unit, slot, by_code() ? 0 : unit.creator(slot), code);
  });
}

Activity Judge::ActivityIn(const Box3d& box, double bound) const {
  meter_->Spend(1);
  if (whole() || region_->BoxCovers(box, 0)) return Activity::kAll;
  return region_->BoxWithin(box, bound) ? Activity::kSome : Activity::kNone;
}

Triangle3d Judge::Corners(const LoadedUnit& unit, uint32_t slot, NodeIndex creator) const {
  const std::array<uint32_t, 3> corners = unit.corners(slot, creator);
  const std::vector<Vec3i>& positions = unit.positions();
  return {grid_.Position(positions[corners[0]]), grid_.Position(positions[corners[1]]),
          grid_.Position(positions[corners[2]])};
}

double Judge::Reach(UnitId unit) const {
  uint8_t largest = index_.unit(unit).error_code_max;
  for (const UnitId child : index_.children(unit)) {
    largest = std::max(largest, index_.unit(child).error_code_max);
  }
  return Bound(largest);
}

}  // namespace mtdb::internal
