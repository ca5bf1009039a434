// SPDX-License-Identifier: Apache-2.0
#include "query/cut/judge.h"

#include <algorithm>
#include <utility>

#include "query/fields/vertical_reach.h"
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
      box_(source.record().bounds),
      bounds_(BoundsByCode(grid_, rounding)),
      levels_(bounds_) {}

RegionPtr Judge::RegionOf(const Query& query) const {
  if (query.region == nullptr || query.region->whole()) return nullptr;
  return vertical_ ? VerticalReach(query.region, aside_) : query.region;
}

ThresholdPtr Judge::ThresholdOf(const Query& query) const {
  return vertical_ ? VerticalReach(query.threshold, aside_) : query.threshold;
}

bool Judge::SameRegion(const Query& query) const {
  if (query.region == query_region_) return true;
  const RegionPtr reach = RegionOf(query);
  if (reach == nullptr || region_ == nullptr) return reach == region_;
  return region_->Shift(*reach, box_) == 0;
}

bool Judge::SameThreshold(const Query& query) const {
  if (threshold() == nullptr || query.threshold == levels_.threshold()) {
    return threshold() != nullptr;
  }
  if (query.threshold == nullptr || asked_ == nullptr) return false;
  const FieldChange change = asked_->Change(*ThresholdOf(query), box_, bounds_.back());
  return change.low == 0 && change.high == 0 && change.shift == 0;
}

bool Judge::Same(const Query& query) const { return SameThreshold(query) && SameRegion(query); }

ThresholdPtr Judge::AttainableAt(const Levels& levels, int level) const {
  ThresholdPtr at = levels.At(level);
  if (level == Levels::kNone && levels.threshold() == nullptr) at = nullptr;
  return Attainable(vertical_ ? VerticalReach(std::move(at), aside_) : at, rounding_);
}

// What is the same stays the same object, so that nobody takes it for another one.
Judge::Fields Judge::FieldsOf(const Levels& levels, const Cutoff& cutoff) const {
  const bool same = fields_.strict != nullptr && levels.threshold() == levels_.threshold();
  const auto at = [&](int level) {
    if (same && level == StrictLevel(cutoff_)) return fields_.strict;
    if (same && level == cutoff_.level && fields_.loose != nullptr) return fields_.loose;
    return AttainableAt(levels, level);
  };
  if (cutoff.level == Levels::kNone) return {at(Levels::kNone), nullptr, 0};
  return {at(StrictLevel(cutoff)), at(cutoff.level), cutoff.from};
}

void Judge::SetQuery(const Query& query, const Cutoff& cutoff) {
  // What may fail comes first.
  const bool same_region = SameRegion(query);
  RegionPtr reach = same_region ? region_ : RegionOf(query);
  ThresholdPtr asked = asked_;
  ThresholdPtr pixel = pixel_;
  Levels levels = levels_;
  if (!SameThreshold(query)) {
    levels.SetThreshold(query.threshold);
    asked = ThresholdOf(query);
    pixel = levels.in_pixels() ? query.threshold->AtPixels(1) : nullptr;
    if (vertical_) pixel = VerticalReach(std::move(pixel), aside_);
  }
  Fields fields = FieldsOf(levels, cutoff);
  if (!same_region) query_region_ = query.region;
  region_ = std::move(reach);
  asked_ = std::move(asked);
  pixel_ = std::move(pixel);
  levels_ = std::move(levels);
  pixels_ = levels_.threshold() == nullptr ? std::nullopt : levels_.threshold()->pixels();
  cutoff_ = cutoff;
  if (fields.strict == fields_.strict) {
    fields_ = std::move(fields);
    return;
  }
  fields_ = std::move(fields);
  constant_ = fields_.strict->constant();
  valid_code_ = -1;
  while (constant_ && valid_code_ < 255 &&
         bounds_[static_cast<size_t>(valid_code_ + 1)] <= *constant_) {
    ++valid_code_;
  }
}

int Judge::LevelOf(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code) const {
  if (pixel_ == nullptr) {
    return Refused(unit, slot, creator, code) ? levels_.LevelOf(code) : Levels::kNone;
  }
  const double bound = bounds_[code];
  const Triangle3d t = Corners(unit, slot, creator);
  if (!Active(t, bound) || !meter_->Spend(1)) return Levels::kNone;
  const double pixel = pixel_->Min(t, bound);
  const double permitted =
      pixels_ ? std::max(*pixels_ * pixel, rounding_) : fields_.strict->Min(t, bound);
  if (bound <= permitted) return Levels::kNone;
  return bound <= rounding_ ? 0 : levels_.LevelOf(bound, pixel);
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

Judge::Codes Judge::CodesIn(const Box3d& box, uint8_t largest) const {
  if (constant_) return {valid_code_, valid_code_};
  const ErrorRange asked = RangeIn(box, bounds_[largest]);
  const auto last_below = [&](double value) {
    return static_cast<int>(std::upper_bound(bounds_.begin(), bounds_.end(), value) -
                            bounds_.begin()) -
           1;
  };
  return {last_below(asked.low), last_below(asked.high)};
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
