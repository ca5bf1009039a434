// SPDX-License-Identifier: Apache-2.0
#include "query/internal/judge.h"

#include <algorithm>
#include <utility>

#include "query/internal/vertical_reach.h"
#include "store/metres_of_unit.h"

namespace mtdb::internal {

namespace {

std::array<double, 2> AsideOf(const ObjectRecord& record) {
  if (!record.border_moves) return {0, 0};
  const std::array<double, 2> metres = MetresOfUnit(record);
  return {1 / metres[0], 1 / metres[1]};
}

}  // namespace

Judge::Judge(const ClusterSource& source, double rounding)
    : vertical_(source.record().error_measure == ErrorMeasure::kVertical),
      aside_(AsideOf(source.record())),
      index_(source.index()),
      grid_(source.record().grid),
      rounding_(rounding),
      bounds_(BoundsByCode(grid_, rounding)) {}

void Judge::SetQuery(const Query& query) {
  const RegionPtr region =
      query.region == nullptr || query.region->whole() ? nullptr : query.region;
  // What is the same stays the same object, so that nobody takes it for another one. What may fail
  // comes first.
  const bool same_region = region == query_region_;
  const bool same_threshold = threshold_ != nullptr && query.threshold == query_threshold_;
  RegionPtr reach = same_region ? region_ : vertical_ ? VerticalReach(region, aside_) : region;
  ThresholdPtr asked = same_threshold ? asked_
                       : vertical_    ? VerticalReach(query.threshold, aside_)
                                      : query.threshold;
  ThresholdPtr attainable = same_threshold ? threshold_ : Attainable(asked, rounding_);
  query_region_ = region;
  region_ = std::move(reach);
  if (same_threshold) return;
  query_threshold_ = query.threshold;
  asked_ = std::move(asked);
  threshold_ = std::move(attainable);
  constant_ = threshold_->constant();
  valid_code_ = -1;
  while (constant_ && valid_code_ < 255 &&
         bounds_[static_cast<size_t>(valid_code_ + 1)] <= *constant_) {
    ++valid_code_;
  }
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
  if (whole() || region_->BoxCovers(box, 0)) return Activity::kAll;
  return region_->BoxWithin(box, bound) ? Activity::kSome : Activity::kNone;
}

Judge::Where Judge::WhereIs(const Box3d& box, double bound) const {
  if (whole()) return {Activity::kAll};
  if (!meter_->Spend(kDepthSteps)) return {Activity::kNone, 0};
  const double depth = region_->Depth(box);
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
