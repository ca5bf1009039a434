// SPDX-License-Identifier: Apache-2.0
#include "query/cut/judged_query.h"

#include <utility>

#include "query/fields/promise.h"
#include "query/fields/vertical_reach.h"
#include "store/metres_of_unit.h"

namespace mtdb::internal {

namespace {

std::array<double, 2> AsideOf(const ObjectRecord& record) {
  if (!record.border_moves) return {0, 0};
  const std::array<double, 2> metres = MetresOfUnit(record);
  return {1 / metres[0], 1 / metres[1]};
}

int StrictLevel(const Cutoff& c) { return std::max(c.level - 1, Levels::kNone); }

}  // namespace

JudgedQuery::JudgedQuery(const ObjectRecord& record, double rounding)
    : vertical_(record.error_measure == ErrorMeasure::kVertical),
      aside_(AsideOf(record)),
      rounding_(rounding),
      box_(record.bounds),
      bounds_(BoundsByCode(record.grid, rounding)),
      levels_(bounds_) {}

RegionPtr JudgedQuery::RegionOf(const Query& query) const {
  if (query.region == nullptr || query.region->whole()) return nullptr;
  return vertical_ ? VerticalReach(query.region, aside_) : query.region;
}

ThresholdPtr JudgedQuery::ThresholdOf(const Query& query) const {
  return vertical_ ? VerticalReach(query.threshold, aside_) : query.threshold;
}

bool JudgedQuery::SameRegion(const Query& query) const {
  if (query.region == query_region_) return true;
  const RegionPtr reach = RegionOf(query);
  if (reach == nullptr || region_ == nullptr) return reach == region_;
  return region_->Shift(*reach, box_) == 0;
}

bool JudgedQuery::SameThreshold(const Query& query) const {
  if (threshold() == nullptr || query.threshold == levels_.threshold()) {
    return threshold() != nullptr;
  }
  if (query.threshold == nullptr || asked_ == nullptr) return false;
  const FieldChange change = asked_->Change(*ThresholdOf(query), box_, bounds_.back());
  return change.low == 0 && change.high == 0 && change.shift == 0;
}

bool JudgedQuery::Same(const Query& query) const {
  return SameThreshold(query) && SameRegion(query);
}

ThresholdPtr JudgedQuery::AttainableAt(const Levels& levels, int level) const {
  ThresholdPtr at = levels.At(level);
  if (level == Levels::kNone && levels.threshold() == nullptr) at = nullptr;
  return Attainable(vertical_ ? VerticalReach(std::move(at), aside_) : at, rounding_);
}

// What is the same stays the same object, so that nobody takes it for another one.
JudgedQuery::Fields JudgedQuery::FieldsOf(const Levels& levels, const Cutoff& cutoff) const {
  const bool same = fields_.strict != nullptr && levels.threshold() == levels_.threshold();
  const auto at = [&](int level) {
    if (same && level == StrictLevel(cutoff_)) return fields_.strict;
    if (same && level == cutoff_.level && fields_.loose != nullptr) return fields_.loose;
    return AttainableAt(levels, level);
  };
  if (cutoff.level == Levels::kNone) return {at(Levels::kNone), nullptr, 0};
  return {at(StrictLevel(cutoff)), at(cutoff.level), cutoff.from};
}

void JudgedQuery::SetQuery(const Query& query, const Cutoff& cutoff) {
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

}  // namespace mtdb::internal
