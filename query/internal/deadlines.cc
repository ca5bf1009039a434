// SPDX-License-Identifier: Apache-2.0
#include "query/internal/deadlines.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "query/internal/rounding.h"

namespace mtdb::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr float kNever = -std::numeric_limits<float>::infinity();  // as a deadline of `low`

constexpr float kNotAsked = std::numeric_limits<float>::quiet_NaN();  // as a side

// As deadlines: what is at least, at most the value.
float Up(double value) {
  const auto f = static_cast<float>(value);
  return f < value ? std::nextafter(f, -kNever) : f;
}
float Down(double value) {
  const auto f = static_cast<float>(value);
  return f > value ? std::nextafter(f, kNever) : f;
}

// An empty list says that no border matters.
void SetShift(std::vector<float>* shifts, size_t size, size_t at, float shift) {
  if (shifts->empty()) {
    if (shift == std::numeric_limits<float>::infinity()) return;
    shifts->assign(size, std::numeric_limits<float>::infinity());
  }
  (*shifts)[at] = shift;
}

void ForgetShifts(UnitDeadlines& d) {
  d.node_shifts.clear();
  d.child_shifts.clear();
  d.sides.clear();
  d.reaches.clear();
}

// Of a side: until when the border cannot have come. Rounded down, so that it is not 0.
float Until(const UnitDeadlines& d, const Judge::Where& where) {
  const double until = (d.shift + where.shift) * (1 - 1e-6);
  if (where.activity == Activity::kSome || !(until > d.shift)) return 0;
  return static_cast<float>(where.activity == Activity::kAll ? until : -until);
}

// A judgement for all of a unit's box stands with such a margin: a share of the range of Min.
double GoodMargin(const ErrorRange& range) {
  constexpr double kShare = 0.5;
  return kShare * (range.high - range.low);
}

}  // namespace

void Deadlines::Begin(const Judge& judge, const ClusterIndex& index, MovingUnit& u) {
  UnitDeadlines& d = u.deadlines;
  d.box = judge.ModelBox(index.unit(u.id).bounds);
  d.reach = judge.Reach(u.id);
  FindRanges(judge, u);
  d.margin = judge.MarginIn(d.box, d.reach);
  d.activity = judge.ActivityIn(d.box, d.reach);
  d.stale = false;
  d.nodes.assign(u.known.size(), kNever);
  d.children.assign(index.children(u.id).size(), kNever);
  ForgetShifts(d);
}

void Deadlines::FindRanges(const Judge& judge, MovingUnit& u) {
  UnitDeadlines& d = u.deadlines;
  d.child_range = judge.RangeIn(d.box, d.reach);
  const bool same = &judge.FieldOf(u.id) == judge.threshold().get();
  d.range = same ? d.child_range : judge.RangeOf(u.id, d.box, d.reach);
}

const Deadlines::Expired& Deadlines::Advance(MovingUnit& u, const Moved& moved) {
  UnitDeadlines& d = u.deadlines;
  expired_.nodes.clear();
  expired_.sides.clear();
  expired_.children.clear();
  bool& all = expired_.all;
  all = d.stale;
  if (all || moved.region) {
    all |= std::exchange(d.activity, judge_.ActivityIn(d.box, d.reach)) != d.activity;
  }
  // What a border does in a unit is counted while one is there.
  const bool was_clear = std::exchange(d.margin, judge_.MarginIn(d.box, d.reach)) > 0;
  all |= was_clear && d.margin <= 0;
  if (!all) all = !AddChange(u, moved, was_clear);
  FindRanges(judge_, u);
  d.stale = false;
  if (all) {
    d.low = d.high = d.shift = 0;
    ForgetShifts(d);
  }
  // Else nothing was or is active there.
  if (all || d.activity != Activity::kNone) FindExpired(u);
  return expired_;
}

FieldChange Deadlines::ChangeIn(const MovingUnit& u, const Judge::Fields& from) const {
  const UnitDeadlines& d = u.deadlines;
  const auto between = [&](const Threshold& a, const Threshold& b) {
    return &a == &b ? FieldChange{{0, 0}} : a.Change(b, d.box, d.reach);
  };
  const Threshold& was = from.Of(u.id);
  const Threshold& is = judge_.FieldOf(u.id);
  FieldChange change = between(was, is);
  if (&was == from.strict.get() && &is == judge_.threshold().get()) return change;
  const FieldChange of_children = between(*from.strict, *judge_.threshold());
  change.low = std::min(change.low, of_children.low);
  change.high = std::max(change.high, of_children.high);
  change.shift = std::max(change.shift, of_children.shift);
  return change;
}

bool Deadlines::AddChange(MovingUnit& u, const Moved& moved, bool was_clear) const {
  UnitDeadlines& d = u.deadlines;
  FieldChange change{{0, 0}};
  if (moved.threshold) change = ChangeIn(u, *moved.from);
  if (was_clear) change.shift = 0;
  if (moved.region && d.activity == Activity::kSome) {
    change.shift = std::max(change.shift, moved.from_region->Shift(*judge_.region(), d.box));
  }
  if (!std::isfinite(change.low) || !std::isfinite(change.high) || !std::isfinite(change.shift)) {
    return false;
  }
  d.low += change.low;
  d.high += change.high;
  d.shift += change.shift;
  d.fell = change.low < 0;
  d.rose = change.high > 0;
  d.shifted = change.shift > 0;
  return true;
}

// What did not fall passes no deadline of `low`, and likewise for the others: no need to look.
void Deadlines::FindExpired(MovingUnit& u) {
  UnitDeadlines& d = u.deadlines;
  const bool all = expired_.all;
  const float low = Down(d.low);
  const float high = Up(d.high);
  const float shift = Up(d.shift);
  const bool shifted = d.shifted && !d.node_shifts.empty();
  const bool sides = d.shifted && !d.sides.empty();
  std::array<uint8_t, 64> passed;
  const auto pass = [&](const std::vector<float>& deadlines, uint32_t word, auto has_passed) {
    const float* const at = deadlines.data() + size_t{word} * 64;
    for (size_t i = 0; i < 64; ++i) passed[i] = has_passed(at[i]) ? 1 : 0;
    return Bits::PackWord(passed.data());
  };
  const auto add = [](uint32_t word, uint64_t rest, std::vector<NodeIndex>* nodes) {
    for (; rest != 0; rest &= rest - 1) {
      nodes->push_back(word * 64 + static_cast<uint32_t>(std::countr_zero(rest)));
    }
  };
  for (uint32_t w = 0; w < u.known.words().size(); ++w) {
    const uint64_t known = u.known.words()[w];
    uint64_t rest = known;
    if (!all && known != 0) {
      const uint64_t refusing = u.refusing.words()[w];
      const uint64_t may_fall = d.fell ? known & ~refusing : 0;
      const uint64_t may_rise = d.rose ? known & refusing : 0;
      rest = 0;
      if (may_fall != 0) rest |= may_fall & pass(d.nodes, w, [&](float f) { return low <= f; });
      if (may_rise != 0) rest |= may_rise & pass(d.nodes, w, [&](float f) { return high >= f; });
      if (shifted) rest |= known & pass(d.node_shifts, w, [&](float f) { return shift >= f; });
      if (sides) {
        const uint64_t near = known & pass(d.sides, w, [](float f) { return f == 0; });
        rest |= near;
        add(w, known & ~rest & pass(d.sides, w, [&](float f) { return shift >= std::abs(f); }),
            &expired_.sides);
      }
    }
    add(w, rest, &expired_.nodes);
  }
  std::erase_if(d.mixed, [&](const UnitDeadlines::Mixed& m) {
    const bool known = u.known.Test(m.node);
    if (all || (shifted && known && shift >= d.node_shifts[m.node])) return true;
    if (sides && known && shift >= std::abs(d.sides[m.node])) return true;
    if (low > m.low && high < m.high) return false;
    expired_.nodes.push_back(m.node);
    return true;
  });
  for (uint32_t c = 0; c < d.children.size(); ++c) {
    const bool stands =
        low > d.children[c] && (d.child_shifts.empty() || !d.shifted || shift < d.child_shifts[c]);
    if (!all && stands) continue;
    d.children[c] = kNever;
    if (!d.child_shifts.empty()) d.child_shifts[c] = kInfinity;
    expired_.children.push_back(c);
  }
}

Activity Deadlines::SideOf(const Judge& judge, MovingUnit& u, const LoadedUnit& unit,
                           NodeIndex node) {
  UnitDeadlines& d = u.deadlines;
  if (d.sides.empty()) {
    d.sides.assign(d.nodes.size(), kNotAsked);
    d.reaches.assign(d.nodes.size(), 0);
  }
  const Box3i box = unit.star_bounds(node);
  const Judge::Where where = judge.WhereIs(judge.ModelBox(box), d.reach);
  d.sides[node] = Until(d, where);
  const IndexRange created = unit.cluster.created_vertices(node);
  if (where.activity == Activity::kSome || created.size() == 0) return where.activity;
  const Vec3i at = unit.cluster.position(*created.begin());
  int64_t reach = 1;
  for (int i = 0; i < 3; ++i) {
    reach = std::max({reach, int64_t{box.max[i]} - at[i], int64_t{at[i]} - box.min[i]});
  }
  d.reaches[node] = static_cast<uint16_t>(reach > 0xffff ? 0 : reach);
  return where.activity;
}

const Deadlines::Expired& Deadlines::LookAside(MovingUnit& u, const LoadedUnit& unit) {
  for (const NodeIndex node : expired_.sides) {
    if (!StaysAside(u, unit, node)) expired_.nodes.push_back(node);
  }
  expired_.sides.clear();
  return expired_;
}

bool Deadlines::StaysAside(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) const {
  UnitDeadlines& d = u.deadlines;
  const int64_t reach = d.reaches[node];
  // One that refuses some triangles has deadlines elsewhere, too.
  if (reach == 0 || d.nodes[node] == kPassed) return false;
  const Vec3i at = unit.cluster.position(unit.cluster.first_vertex(node));
  Box3i around = units_.index().unit(u.id).bounds;
  for (int i = 0; i < 3; ++i) {
    around.min[i] = static_cast<int32_t>(std::max<int64_t>(around.min[i], at[i] - reach));
    around.max[i] = static_cast<int32_t>(std::min<int64_t>(around.max[i], at[i] + reach));
  }
  const float side = Until(d, judge_.WhereIs(judge_.ModelBox(around), d.reach));
  if (side == 0 || (side > 0) != (d.sides[node] > 0)) return false;
  d.sides[node] = side;
  return true;
}

// First by the range of the threshold around all of the unit, then around the hole, then triangle
// by triangle.
Deadlines::Verdict Deadlines::Look(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  const UnitDeadlines& d = u.deadlines;
  const double bound = judge_.Bound(unit.cluster.error_codes[node]);
  if (d.activity == Activity::kNone) return {};
  judge_.meter().Spend(1);
  const double good = GoodMargin(d.range);
  Box3d box;
  double shift = kInfinity;  // of the threshold's borders
  if (d.margin <= 0) {
    box = judge_.ModelBox(unit.hole_bounds(node));
    shift = judge_.MarginIn(box, bound);
  }
  if (!d.sides.empty()) u.deadlines.sides[node] = kNotAsked;
  if (d.range.low - bound >= good) return {false, false, {d.range.low - bound, kInfinity, shift}};
  if (d.activity == Activity::kAll && bound - d.range.high >= good && bound > d.range.high) {
    return {true, true, {kInfinity, bound - d.range.high, shift}};
  }
  Activity activity = d.activity;
  if (activity == Activity::kSome) activity = SideOf(judge_, u, unit, node);
  if (activity == Activity::kNone) return {};
  if (d.margin > 0) box = judge_.ModelBox(unit.hole_bounds(node));
  if (activity == Activity::kSome) activity = judge_.ActivityIn(box, bound);
  if (activity == Activity::kNone) return {};
  const ErrorRange range = judge_.FieldOf(u.id).Range(box, bound);
  if (bound <= range.low) return {false, false, {range.low - bound, kInfinity, shift}};
  if (activity == Activity::kAll && bound > range.high) {
    return {true, true, {kInfinity, bound - range.high, shift}};
  }
  return LookAtTriangles(unit, node, activity == Activity::kAll, shift);
}

Deadlines::Verdict Deadlines::LookAtTriangles(const LoadedUnit& unit, NodeIndex node,
                                              bool all_active, double shift) {
  const double bound = judge_.Bound(unit.cluster.error_codes[node]);
  const std::span<const LocalNumber> hole = unit.cluster.hole(node);
  const Threshold& field = judge_.FieldOf(unit.id);
  refused_.assign(hole.size(), false);
  Verdict verdict{false, true, {kInfinity, kInfinity, shift}};
  for (size_t i = 0; i < hole.size(); ++i) {
    if (!judge_.meter().Spend(1)) break;
    const Triangle3d t = judge_.Corners(unit, hole[i], unit.creator(hole[i]));
    const bool active = all_active || judge_.Active(t, bound);
    const double least = active ? field.Min(t, bound) : kInfinity;
    if (bound <= least) {
      verdict.all = false;
      verdict.leeway.fall = std::min(verdict.leeway.fall, least - bound);
    } else {
      verdict.some = refused_[i] = true;
      verdict.leeway.rise = std::min(verdict.leeway.rise, bound - least);
    }
  }
  return verdict;
}

bool Deadlines::Evaluate(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  ++evaluated_;
  UnitDeadlines& d = u.deadlines;
  const Verdict verdict = Look(u, unit, node);
  const bool mixed = verdict.some && !verdict.all;
  const Leeway& leeway = verdict.leeway;
  const float low = Up(d.low - leeway.fall);
  const float high = Down(d.high + leeway.rise);
  SetShift(&d.node_shifts, d.nodes.size(), node, Down(d.shift + leeway.shift));
  if (mixed) d.mixed.push_back({node, low, high});
  // `high` never reaches infinity: a mixed node is found in `mixed` only.
  d.nodes[node] = mixed ? kPassed : verdict.some ? high : low;
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

bool Deadlines::Learn(MovingUnit& u, NodeIndex node, uint8_t code) {
  units_.Save(u);
  u.known.Set(node);
  UnitDeadlines& d = u.deadlines;
  // Most are valid by far, and their code says so.
  const double fall = d.range.low - judge_.Bound(code);
  const bool valid = d.margin > 0 && fall >= GoodMargin(d.range);
  d.nodes[node] = valid ? Up(d.low - fall) : kPassed;
  SetShift(&d.node_shifts, d.nodes.size(), node, kInfinity);
  if (!d.sides.empty()) d.sides[node] = kNotAsked;
  evaluated_ += valid ? 1 : 0;
  return !valid;
}

void Deadlines::Forget(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  units_.Save(u);
  u.known.Clear(node);
  u.refusing.Clear(node);
  u.refused.ClearRange(unit.cluster.hole_begin[node], unit.cluster.hole_begin[node + 1]);
}

Leeway Deadlines::Margin(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot,
                         uint8_t code) const {
  constexpr Leeway kRefused{-1, kInfinity, kInfinity};
  const UnitDeadlines& d = u.deadlines;
  const double bound = judge_.Bound(code);
  if (d.activity == Activity::kNone || !judge_.meter().Spend(1)) return {};
  const bool clear = d.margin > 0;
  if (clear && bound <= d.child_range.low) return {d.child_range.low - bound};
  if (d.activity == Activity::kAll && bound > d.child_range.high) return kRefused;
  const Triangle3d t = judge_.Corners(unit, slot, unit.creator(slot));
  if (d.activity == Activity::kSome) {
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

Leeway Deadlines::ChildMargin(const MovingUnit& u, UnitId child) const {
  constexpr double kGoodShare = 0.1;  // of the range of Min; less says too little
  const double bound = judge_.Bound(units_.LargestCode(child));
  const Box3d box = judge_.ModelBox(units_.index().unit(child).bounds);
  const ErrorRange range = judge_.RangeIn(box, bound);
  const double fall = range.low - bound;
  if (fall < kGoodShare * (range.high - range.low)) return {-1, kInfinity, kInfinity};
  return {fall, kInfinity, u.deadlines.margin > 0 ? kInfinity : judge_.MarginIn(box, bound)};
}

void Deadlines::SetChild(MovingUnit& u, uint32_t ordinal, const Leeway& leeway) {
  UnitDeadlines& d = u.deadlines;
  const bool known = leeway.fall >= 0;
  d.children[ordinal] = known ? Up(d.low - leeway.fall) : kNever;
  SetShift(&d.child_shifts, d.children.size(), ordinal,
           known ? Down(d.shift + leeway.shift) : kInfinity);
}

void Deadlines::AddChild(MovingUnit& u, uint32_t ordinal, const Leeway& leeway) {
  UnitDeadlines& d = u.deadlines;
  d.children[ordinal] = std::max(d.children[ordinal], Up(d.low - leeway.fall));
  const float before = d.child_shifts.empty() ? kInfinity : d.child_shifts[ordinal];
  SetShift(&d.child_shifts, d.children.size(), ordinal,
           std::min(before, Down(d.shift + leeway.shift)));
}

void Deadlines::SetChildWaits(MovingUnit& u, uint32_t ordinal) {
  u.deadlines.children[ordinal] = kPassed;
}

}  // namespace mtdb::internal
