// SPDX-License-Identifier: Apache-2.0
#include "query/moving/decisions.h"

#include <algorithm>
#include <limits>

#include "query/fields/rounding.h"

namespace mtdb::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A judgement for all of a unit's box stands with such a margin: a share of the range of Min.
double GoodMargin(const ErrorRange& range) {
  constexpr double kShare = 0.5;
  return kShare * (range.high - range.low);
}

void FindSide(const Judge& judge, UnitDeadlines& d, const LoadedUnit& unit, NodeIndex node) {
  const Box3i box = unit.star_bounds(node);
  d.SetSide(node, d.SideFrom(judge.WhereIs(judge.ModelBox(box), d.bounds.reach)));
  d.SetReach(unit, node, box);
}

}  // namespace

Activity Decisions::SideOf(const Judge& judge, UnitDeadlines& d, const LoadedUnit& unit,
                           NodeIndex node) {
  if (!d.side(node).asked()) {
    FindSide(judge, d, unit, node);
    // The decision does not depend on it: when the border moves it is found again.
    if (d.side(node).at_border()) d.SetShift(node, Deadline::Risen(d.sum.shift));
  }
  return d.side(node).activity();
}

// First by the range of the threshold around all of the unit, then around the hole, then triangle
// by triangle.
Decisions::Verdict Decisions::Look(UnitDeadlines& d, const LoadedUnit& unit, NodeIndex node) {
  const UnitBounds& b = d.bounds;
  const double bound = judge_.Bound(unit.cluster.error_codes[node]);
  if (b.activity == Activity::kNone) return {};
  judge_.meter().Spend(1);
  const double good = GoodMargin(b.range);
  Box3i hole;
  Box3d box;
  const auto find_box = [&] {
    hole = unit.hole_bounds(node);
    box = judge_.ModelBox(hole);
  };
  double shift = kInfinity;  // of borders
  if (b.margin <= 0) {
    find_box();
    shift = judge_.MarginIn(box, bound);
  }
  d.SetSide(node, Side());
  if (b.range.low - bound >= good) return {false, false, {b.range.low - bound, kInfinity, shift}};
  if (b.activity == Activity::kAll && bound - b.range.high >= good && bound > b.range.high) {
    return {true, true, {kInfinity, bound - b.range.high, shift}};
  }
  Activity activity = b.activity;
  if (activity == Activity::kSome) {
    FindSide(judge_, d, unit, node);
    activity = d.side(node).activity();
  }
  if (activity == Activity::kNone) return {};
  if (b.margin > 0) find_box();
  if (activity == Activity::kSome) {
    const Judge::Where where = judge_.WhereIs(box, bound);
    activity = where.activity;
    if (activity == Activity::kNone) return {false, false, {kInfinity, kInfinity, where.shift}};
    shift = std::min(shift, activity == Activity::kAll ? where.shift : Length(box.max - box.min));
  } else if (d.reach(node) == 0) {
    for (const uint32_t local : unit.cluster.created_vertices(node)) {
      hole.Add(unit.cluster.position(local));
    }
    d.SetReach(unit, node, hole);
  }
  const ErrorRange range = judge_.FieldOf(unit.id).Range(box, bound);
  if (bound <= range.low) return {false, false, {range.low - bound, kInfinity, shift}};
  if (activity == Activity::kAll && bound > range.high) {
    return {true, true, {kInfinity, bound - range.high, shift}};
  }
  return LookAtTriangles(unit, node, activity == Activity::kAll, shift);
}

Decisions::Verdict Decisions::LookAtTriangles(const LoadedUnit& unit, NodeIndex node,
                                              bool all_active, double shift) {
  const double bound = judge_.Bound(unit.cluster.error_codes[node]);
  const std::span<const LocalNumber> hole = unit.cluster.hole(node);
  const Threshold& field = judge_.FieldOf(unit.id);
  refused_.assign(hole.size(), false);
  Verdict verdict{false, true, {}};
  for (size_t i = 0; i < hole.size(); ++i) {
    if (!judge_.meter().Spend(1)) break;
    const Triangle3d t = judge_.Corners(unit, hole[i], unit.creator(hole[i]));
    const bool active = all_active || judge_.Active(t, bound);
    if (!all_active) shift = ActiveLeeway(t, bound, active, shift);
    const double least = active ? field.Min(t, bound) : kInfinity;
    if (bound <= least) {
      verdict.all = false;
      verdict.leeway.fall = std::min(verdict.leeway.fall, least - bound);
    } else {
      verdict.some = refused_[i] = true;
      verdict.leeway.rise = std::min(verdict.leeway.rise, bound - least);
    }
  }
  verdict.leeway.shift = shift;
  return verdict;
}

double Decisions::ActiveLeeway(const Triangle3d& t, double bound, bool active, double most) const {
  if (!(most > 0) || !judge_.meter().Spend(1)) return 0;
  const Region& region = *judge_.region();
  if (!active) return std::clamp(-region.Depth(Around(t)) - bound, 0.0, most);
  // As long as the region covers a corner.
  double deepest = 0;
  for (size_t c = 0; c < 3 && deepest < most; ++c) {
    Box3d corner;
    corner.Add(t[c]);
    deepest = std::max(deepest, region.Depth(corner));
  }
  return std::min(deepest, most);
}

bool Decisions::Evaluate(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  ++evaluated_;
  UnitDeadlines& d = u.deadlines;
  const Verdict verdict = Look(d, unit, node);
  const bool mixed = verdict.some && !verdict.all;
  mixed ? d.SetMixed(node, verdict.leeway) : d.SetLeeway(node, verdict.some, verdict.leeway);
  const uint32_t begin = unit.cluster.hole_begin[node];
  const uint32_t end = unit.cluster.hole_begin[node + 1];
  bool same = u.refusing.Test(node) == verdict.some;
  if (mixed) {
    for (uint32_t i = begin; i < end; ++i) same &= u.refused.Test(i) == refused_[i - begin];
  } else {
    same &= u.refused.CountRange(begin, end) == (verdict.all ? end - begin : 0);
  }
  if (same) return false;
  units_.Save(u);
  u.refusing.Put(node, verdict.some);
  u.refused.ClearRange(begin, end);
  if (verdict.all) u.refused.SetRange(begin, end);
  for (uint32_t i = begin; mixed && i < end; ++i) {
    if (refused_[i - begin]) u.refused.Set(i);
  }
  return true;
}

bool Decisions::Learn(MovingUnit& u, NodeIndex node, uint8_t code) {
  units_.Save(u);
  u.known.Set(node);
  UnitDeadlines& d = u.deadlines;
  // Most are valid by far, and their code says so.
  const double fall = d.bounds.range.low - judge_.Bound(code);
  const bool valid = d.bounds.margin > 0 && fall >= GoodMargin(d.bounds.range);
  d.SetNode(node, false, valid ? Deadline::Fallen(d.sum.low - fall) : Deadline::Passed());
  d.SetShift(node, Deadline::NeverRisen());
  d.SetSide(node, Side());
  evaluated_ += valid ? 1 : 0;
  return !valid;
}

void Decisions::Forget(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  units_.Save(u);
  u.deadlines.SetNode(node, false, Deadline::NeverFallen());
  u.deadlines.SetShift(node, Deadline::NeverRisen());
  u.deadlines.SetSide(node, Side());
  u.known.Clear(node);
  u.refusing.Clear(node);
  u.refused.ClearRange(unit.cluster.hole_begin[node], unit.cluster.hole_begin[node + 1]);
}

Leeway Decisions::Margin(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot,
                         uint8_t code) const {
  constexpr Leeway kRefused{-1, kInfinity, kInfinity};
  const UnitBounds& b = u.deadlines.bounds;
  const double bound = judge_.Bound(code);
  if (b.activity == Activity::kNone || !judge_.meter().Spend(1)) return {};
  const bool clear = b.margin > 0;
  if (clear && bound <= b.child_range.low) return {b.child_range.low - bound};
  if (b.activity == Activity::kAll && bound > b.child_range.high) return kRefused;
  const Triangle3d t = judge_.Corners(unit, slot, unit.creator(slot));
  if (b.activity == Activity::kSome) {
    const Judge::Where where = judge_.WhereIs(Around(t), bound);
    if (where.activity == Activity::kNone) return {kInfinity, kInfinity, where.shift};
    if (where.activity == Activity::kSome && !judge_.Active(t, bound)) {
      return {kInfinity, kInfinity, 0};
    }
  }
  const double least = judge_.threshold()->Min(t, bound);
  if (bound > least) return kRefused;
  return {least - bound, kInfinity, clear ? kInfinity : judge_.MarginIn(Around(t), bound)};
}

Leeway Decisions::ChildMargin(const MovingUnit& u, UnitId child) const {
  constexpr double kGoodShare = 0.1;  // of the range of Min; less says too little
  const double bound = judge_.Bound(units_.LargestCode(child));
  const Box3d box = judge_.ModelBox(units_.index().unit(child).bounds);
  const ErrorRange range = judge_.RangeIn(box, bound);
  const double fall = range.low - bound;
  if (fall < kGoodShare * (range.high - range.low)) return {-1, kInfinity, kInfinity};
  return {fall, kInfinity, u.deadlines.bounds.margin > 0 ? kInfinity : judge_.MarginIn(box, bound)};
}

}  // namespace mtdb::internal
