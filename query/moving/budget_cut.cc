// SPDX-License-Identifier: Apache-2.0
#include "query/moving/budget_cut.h"

#include <algorithm>
#include <cmath>

#include "query/cache/available_units.h"

namespace mtdb::internal {
namespace {

// A step ends when the mesh is too large by this part of the budget.
constexpr uint64_t kTooLarge = 8;

}  // namespace

Cutoff BudgetCut::CutoffAt(uint64_t position) const {
  if (position >= end_) return {};
  return {top_ - static_cast<int>(position / units()),
          static_cast<UnitId>(units() - position % units())};
}

Status BudgetCut::Move(UnitReader& reader, const Query& query, bool goes_on, MovingCut* cut) {
  reader_ = &reader;
  query_ = &query;
  cut_ = cut;
  most_ = *query.max_triangles;
  evaluated_ = 0;
  done_ = fits_ = false;
  if (!goes_on) {
    const bool in_pixels = Levels::InPixels(query.threshold);
    if (in_pixels != in_pixels_) position_ = 0;
    in_pixels_ = in_pixels;
    top_ = Levels::TopOf(in_pixels);
    end_ = static_cast<uint64_t>(top_ + 1) * units();
    known_.good = 0;
    known_.too_far = end_ + 1;
    known_.tries = 0;
    // Of a query that was left on the way, or had a larger budget.
    if (triangles() > most_) position_ -= std::min(StepsAway(), position_);
  }
  MTDB_RETURN_IF_ERROR(To(position_, true));
  const AvailableUnits* const available = reader.available();
  for (bool stepped = !goes_on; Note(); stepped = true) {
    const bool last = known_.good == end_ || known_.good + 1 == known_.too_far;
    done_ = last && position_ == known_.good;
    if (done_ || (stepped && available != nullptr && available->time_is_over())) break;
    MTDB_RETURN_IF_ERROR(To(last ? known_.good : Next(), false));
  }
  return cut_->EndMoves(*reader_, done_, !ended_by_budget());
}

Status BudgetCut::To(uint64_t position, bool first) {
  const uint64_t before = triangles();
  const uint64_t from = position_;
  position_ = position;
  const Status status =
      cut_->MoveTo(*reader_, *query_, CutoffAt(position), most_ + most_ / kTooLarge, first);
  evaluated_ += cut_->evaluated();
  const double places = static_cast<double>(position) - static_cast<double>(from);
  const double more = static_cast<double>(triangles()) - static_cast<double>(before);
  if (known_.tries > 0 && places != 0 && std::abs(places) < static_cast<double>(units()) &&
      more / places > 1) {
    per_place_ = more / places;
  }
  return status;
}

bool BudgetCut::Note() {
  const AvailableUnits* const available = reader_->available();
  // The root is given whatever the budget is.
  const bool too_large = triangles() > most_ && cut_->counts().applied > 0;
  fits_ = !too_large;
  // What is on the way is a part of where it leads.
  if (!too_large) {
    if (cut_->unfinished() || (available != nullptr && available->out_of_time())) return false;
    known_.good = std::max(known_.good, position_);
    if (known_.good >= known_.too_far) known_.too_far = end_ + 1;  // less is there than before
  } else {
    known_.too_far = std::min(known_.too_far, position_);
    // More has come since it fitted.
    if (known_.good >= known_.too_far) known_.good = 0;
  }
  ++known_.tries;
  return true;
}

uint64_t BudgetCut::StepsAway() const {
  const uint64_t have = triangles();
  if (have + have / 2 < most_ || have > most_ + most_ / kTooLarge) return Levels::kOctave * units();
  // From a level to the next, of which an octave has eight, it is about a tenth of the triangles.
  const double guess = 0.1 * static_cast<double>(have) /
                       static_cast<double>(std::max<size_t>(1, cut_->open_units()));
  const double gap = std::abs(static_cast<double>(most_) - static_cast<double>(have));
  return std::max<uint64_t>(
      1, static_cast<uint64_t>(gap / std::max(1.0, per_place_ > 0 ? per_place_ : guess)));
}

// By what the triangles say, in longer and longer steps; in the end by halves.
uint64_t BudgetCut::Next() const {
  const uint64_t between = known_.good + (known_.too_far - known_.good) / 2;
  const bool bounded = known_.too_far <= end_ && (known_.good > 0 || known_.too_far <= 1);
  if (bounded && known_.tries > 3) return between;
  const uint64_t steps = StepsAway() << std::min(std::max(known_.tries - 2, 0), 16);
  const uint64_t next = position_ == known_.too_far
                            ? known_.too_far - std::min(steps, known_.too_far)
                            : position_ + std::min(steps, end_ - position_);
  if (!bounded) return std::min(next, known_.too_far - 1);
  return std::clamp(next, known_.good + 1, known_.too_far - 1);
}

}  // namespace mtdb::internal
