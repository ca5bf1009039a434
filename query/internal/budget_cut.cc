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
  MTDB_RETURN_IF_ERROR(cut_->FindActive(*reader_, !ended_by_budget()));
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
  MTDB_RETURN_IF_ERROR(To(PositionOf(outcome.cutoff)));
  // Between two levels, of which there are eight an octave, lies about a tenth of the triangles.
  const auto units = static_cast<double>(std::max<size_t>(1, cut_->open_units()));
  per_step_ = 0.1 * static_cast<double>(cut_->counts().triangles) / units;
  return Status::Ok();
}

uint64_t BudgetCut::StepsFor(uint64_t triangles) const {
  const double steps = static_cast<double>(triangles) / std::max(per_step_, 1.0);
  return std::max<uint64_t>(1, static_cast<uint64_t>(steps));
}

// Between a place that fits and one that does not: by the triangles that a step took last, and then
// by halves.
Status BudgetCut::Adjust() {
  uint64_t fits = 0;
  uint64_t too_far = end_ + 1;
  uint64_t factor = 1;
  for (;;) {
    const uint64_t triangles = cut_->counts().triangles;
    const uint64_t here = position_;
    const bool good = here == 0 || Fits();
    (good ? fits : too_far) = here;
    if (good && (here == end_ || too_far == here + 1)) return Status::Ok();
    const bool bounded = fits > 0 && too_far <= end_;
    uint64_t next = 0;
    if (good) {
      next = here + std::min(StepsFor(most_ - std::min(most_, triangles)) * factor, end_ - here);
    } else {
      next = here - std::min(StepsFor(triangles - most_) * factor, here);
    }
    if (bounded && factor > 2) next = fits + (too_far - fits) / 2;
    // Of two neighbours one fits.
    next = too_far - fits == 1 ? fits : std::clamp(next, fits + 1, too_far - 1);
    MTDB_RETURN_IF_ERROR(To(next));
    factor *= 2;
    const auto steps = static_cast<double>(position_) - static_cast<double>(here);
    const auto more =
        static_cast<double>(cut_->counts().triangles) - static_cast<double>(triangles);
    if (more / steps > 0) per_step_ = more / steps;
  }
}

}  // namespace mtdb::internal
