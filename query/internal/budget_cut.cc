// SPDX-License-Identifier: Apache-2.0
#include "query/internal/budget_cut.h"

#include <algorithm>
#include <utility>

#include "query/internal/search.h"

namespace mtdb::internal {
namespace {

// Farther away than this part of the budget, a search is quicker.
constexpr uint64_t kNear = 8;

}  // namespace

Cutoff BudgetCut::CutoffAt(uint64_t position) const {
  if (position >= end_) return {};
  const uint64_t units = source_.index().unit_count();
  return {top_ - static_cast<int>(position / units), static_cast<UnitId>(units - position % units)};
}

uint64_t BudgetCut::PositionOf(const Cutoff& cutoff) const {
  if (cutoff.level == Levels::kNone) return end_;
  const uint64_t units = source_.index().unit_count();
  return static_cast<uint64_t>(top_ - cutoff.level) * units + (units - cutoff.from);
}

Status BudgetCut::Move(UnitReader& reader, const Query& query, MovingCut* cut) {
  reader_ = &reader;
  query_ = &query;
  cut_ = cut;
  most_ = *query.max_triangles;
  evaluated_ = 0;
  const bool in_pixels = query.threshold != nullptr && query.threshold->AtPixels(1) != nullptr;
  bool known = std::exchange(known_, false) && in_pixels_ == in_pixels;
  in_pixels_ = in_pixels;
  top_ = Levels::TopOf(in_pixels);
  end_ = static_cast<uint64_t>(top_ + 1) * source_.index().unit_count();
  if (known) {
    MTDB_RETURN_IF_ERROR(To(position_));
    const uint64_t triangles = cut_->counts().triangles;
    known = !cut_->unfinished() && (position_ == end_ || triangles + most_ / kNear >= most_);
  }
  MTDB_RETURN_IF_ERROR(known ? Adjust() : Search());
  MTDB_RETURN_IF_ERROR(cut_->FindActive(
      *reader_, ended_by_budget() ? Survey::Promise::kUnsaid : Survey::Promise::kKept));
  known_ = true;
  return Status::Ok();
}

Status BudgetCut::To(uint64_t position) {
  position_ = position;
  const Status status = cut_->MoveTo(*reader_, *query_, CutoffAt(position), most_ + most_ / kNear);
  evaluated_ += cut_->evaluated();
  return status;
}

Status BudgetCut::Search() {
  CutState state(source_, false);
  internal::Search search(source_, *reader_, *query_, source_.record().rounding_error, &state);
  MTDB_ASSIGN_OR_RETURN(const internal::Search::Outcome outcome, search.Run());
  evaluated_ += outcome.nodes_visited;
  last_way_ = 1;
  return To(PositionOf(outcome.cutoff));
}

Status BudgetCut::Adjust() {
  const uint64_t start = position_;
  uint64_t step = std::max<uint64_t>(1, last_way_ / 2);
  uint64_t fits = position_;
  uint64_t too_far = end_ + 1;  // the first known not to fit
  if (Fits()) {
    while (fits < end_ && too_far > end_) {
      MTDB_RETURN_IF_ERROR(To(std::min(fits + step, end_)));
      (Fits() ? fits : too_far) = position_;
      step *= 2;
    }
  } else {
    for (bool found = false; !found; step *= 2) {
      too_far = position_;
      MTDB_RETURN_IF_ERROR(To(too_far - std::min(step, too_far)));
      found = position_ == 0 || Fits();
    }
    fits = position_;
  }
  while (too_far - fits > 1 && fits < end_) {
    MTDB_RETURN_IF_ERROR(To(fits + (too_far - fits) / 2));
    (Fits() ? fits : too_far) = position_;
  }
  last_way_ = fits > start ? fits - start : start - fits;
  return position_ == fits ? Status::Ok() : To(fits);
}

}  // namespace mtdb::internal
