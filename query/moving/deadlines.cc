// SPDX-License-Identifier: Apache-2.0
#include "query/moving/deadlines.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "query/fields/rounding.h"

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
void SetShiftAt(std::vector<float>* shifts, size_t size, size_t at, float shift) {
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
}

// Of a side: until when the border cannot have come. Rounded down, so that it is not 0.
float Until(const UnitDeadlines& d, const Judge::Where& where) {
  const double until = (d.shift + where.shift) * (1 - 1e-6);
  if (where.activity == Activity::kSome || !(until > d.shift)) return 0;
  return static_cast<float>(where.activity == Activity::kAll ? until : -until);
}

// Of 64 values the first one by `before` that is beyond `limit`, which NaN is not; else `none`. In
// eight lanes.
template <typename Before>
float First(const float* values, float limit, float none, Before&& before) {
  constexpr size_t kLanes = 8;
  std::array<float, kLanes> first;
  first.fill(none);
  for (size_t i = 0; i < 64; i += kLanes) {
    for (size_t l = 0; l < kLanes; ++l) {
      const float v = before(limit, values[i + l]) ? values[i + l] : none;
      first[l] = before(v, first[l]) ? v : first[l];
    }
  }
  for (const float f : first) none = before(f, none) ? f : none;
  return none;
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
  d.reaches.assign(u.known.size(), 0);
  d.soonest.assign(u.known.words().size(), {});
  ForgetShifts(d);
}

void Deadlines::SetNode(UnitDeadlines& d, NodeIndex node, bool refuses, float deadline) {
  d.nodes[node] = deadline;
  UnitDeadlines::Soonest& soonest = d.soonest[node / 64];
  if (refuses) {
    soonest.high = std::min(soonest.high, deadline);
  } else {
    soonest.low = std::max(soonest.low, deadline);
  }
}

void Deadlines::SetShift(UnitDeadlines& d, NodeIndex node, float shift) {
  SetShiftAt(&d.node_shifts, d.nodes.size(), node, shift);
  d.soonest[node / 64].shift = std::min(d.soonest[node / 64].shift, shift);
}

void Deadlines::SetSide(UnitDeadlines& d, NodeIndex node, float side) {
  if (d.sides.empty()) {
    if (std::isnan(side)) return;
    d.sides.assign(d.nodes.size(), kNotAsked);
  }
  d.sides[node] = side;
  float& soonest = d.soonest[node / 64].side;
  if (side != 0) soonest = std::min(soonest, std::abs(side));  // not a number: it stays
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

FieldChange Deadlines::ChangeIn(const MovingUnit& u, const Box3d& box,
                                const Judge::Fields& from) const {
  const auto between = [&](const Threshold& a, const Threshold& b) {
    return &a == &b ? FieldChange{{0, 0}} : a.Change(b, box, u.deadlines.reach);
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
  if (moved.threshold) change = ChangeIn(u, d.box, *moved.from);
  if (was_clear) change.shift = 0;
  if (moved.region && d.activity == Activity::kSome) {
    change.shift = std::max(change.shift, moved.from_region->Shift(*judge_.region(), d.box));
  }
  if (!std::isfinite(change.low) || !std::isfinite(change.high) || !std::isfinite(change.shift)) {
    return false;
  }
  d.low += change.low;
  d.high += change.high;
  d.shift_before = d.shift;
  d.shift += change.shift;
  d.fell = change.low < 0;
  d.rose = change.high > 0;
  d.shifted = change.shift > 0;
  return true;
}

void Deadlines::FindExpired(MovingUnit& u) {
  UnitDeadlines& d = u.deadlines;
  const bool all = expired_.all;
  if (all) {
    u.known.ForEach([&](NodeIndex node) { expired_.nodes.push_back(node); });
    d.nodes.assign(d.nodes.size(), kNever);
    d.soonest.assign(d.soonest.size(), {});
    d.mixed.clear();
  } else {
    FindExpiredNodes(u);
    FindExpiredMixed(u);
  }
  const float low = Down(d.low);
  const float shift = Up(d.shift);
  for (uint32_t c = 0; c < d.children.size(); ++c) {
    const bool stands =
        low > d.children[c] && (d.child_shifts.empty() || !d.shifted || shift < d.child_shifts[c]);
    if (!all && stands) continue;
    d.children[c] = kNever;
    if (!d.child_shifts.empty()) d.child_shifts[c] = kInfinity;
    expired_.children.push_back(c);
  }
}

// What did not fall passes no deadline of `low`, and likewise for the others: no need to look.
// Since `low` is not above `high`, of what has not passed only deadlines of `low` are below it, and
// only those of `high` above that.
void Deadlines::FindExpiredNodes(MovingUnit& u) {
  UnitDeadlines& d = u.deadlines;
  const float low = Down(d.low);
  const float high = Up(d.high);
  const float shift = Up(d.shift);
  constexpr auto kLess = [](float a, float b) { return a < b; };
  constexpr auto kMore = [](float a, float b) { return a > b; };
  const auto add = [](uint32_t word, uint64_t rest, std::vector<NodeIndex>* nodes) {
    for (; rest != 0; rest &= rest - 1) {
      nodes->push_back(word * 64 + static_cast<uint32_t>(std::countr_zero(rest)));
    }
  };
  for (uint32_t w = 0; w < d.soonest.size(); ++w) {
    UnitDeadlines::Soonest& soonest = d.soonest[w];
    const size_t first = size_t{w} * 64;
    const uint64_t known = u.known.words()[w];
    const uint64_t refusing = u.refusing.words()[w];
    uint64_t nodes = 0;
    uint64_t sides = 0;
    if (d.fell && low <= soonest.low) {
      const float* const at = d.nodes.data() + first;
      nodes |= ~refusing & BitsWhere(at, [&](float f) { return low <= f; });
      soonest.low = First(at, low, kNever, kMore);
    }
    if (d.rose && high >= soonest.high) {
      const float* const at = d.nodes.data() + first;
      nodes |= refusing & BitsWhere(at, [&](float f) { return high >= f; });
      soonest.high = First(at, high, kPassed, kLess);
    }
    if (d.shifted && shift >= soonest.shift) {
      const float* const at = d.node_shifts.data() + first;
      nodes |= BitsWhere(at, [&](float f) { return shift >= f; });
      soonest.shift = First(at, shift, kPassed, kLess);
    }
    if (d.shifted && shift >= soonest.side) {
      std::array<float, 64> until;
      for (size_t i = 0; i < 64; ++i) until[i] = std::abs(d.sides[first + i]);
      sides = BitsWhere(until.data(), [&](float f) { return (f != 0) & (f <= shift); });
      soonest.side = First(until.data(), shift, kPassed, kLess);
    }
    add(w, known & nodes, &expired_.nodes);
    add(w, known & sides & ~nodes, &expired_.sides);
  }
}

void Deadlines::FindExpiredMixed(MovingUnit& u) {
  UnitDeadlines& d = u.deadlines;
  const float low = Down(d.low);
  const float high = Up(d.high);
  const float shift = Up(d.shift);
  std::erase_if(d.mixed, [&](const UnitDeadlines::Mixed& m) {
    if (low > m.low && high < m.high) return false;
    d.nodes[m.node] = kPassed;
    const float side = d.sides.empty() ? kNotAsked : d.sides[m.node];
    const bool found = d.shifted && ((!d.node_shifts.empty() && shift >= d.node_shifts[m.node]) ||
                                     (side != 0 && shift >= std::abs(side)));
    if (!found) expired_.nodes.push_back(m.node);
    return true;
  });
}

Activity Deadlines::SideOf(const Judge& judge, MovingUnit& u, const LoadedUnit& unit,
                           NodeIndex node) {
  UnitDeadlines& d = u.deadlines;
  if (d.sides.empty() || std::isnan(d.sides[node])) {
    FindSide(judge, d, unit, node);
    // The decision does not depend on it: when the border moves it is found again.
    if (d.sides[node] == 0) SetShift(d, node, Down(d.shift));
  }
  return SideToActivity(d.sides[node]);
}

void Deadlines::FindSide(const Judge& judge, UnitDeadlines& d, const LoadedUnit& unit,
                         NodeIndex node) {
  const Box3i box = unit.star_bounds(node);
  SetSide(d, node, Until(d, judge.WhereIs(judge.ModelBox(box), d.reach)));
  SetReach(d, unit, node, box);
}

void Deadlines::SetReach(UnitDeadlines& d, const LoadedUnit& unit, NodeIndex node,
                         const Box3i& box) {
  const IndexRange created = unit.cluster.created_vertices(node);
  if (created.size() == 0) return;
  const Vec3i at = unit.cluster.position(*created.begin());
  int64_t reach = 1;
  for (int i = 0; i < 3; ++i) {
    reach = std::max({reach, int64_t{box.max[i]} - at[i], int64_t{at[i]} - box.min[i]});
  }
  d.reaches[node] = static_cast<uint16_t>(reach > 0xffff ? 0 : reach);
}

const Deadlines::Expired& Deadlines::LookAround(MovingUnit& u, const LoadedUnit& unit,
                                                const Moved& moved) {
  if (expired_.all) return expired_;
  UnitDeadlines& d = u.deadlines;
  // Keeps those that do not stand. They are in `mixed` no more.
  const auto look = [&](std::vector<NodeIndex>& nodes, auto stands) {
    constexpr size_t kAtOnce = 32;
    size_t left = 0;
    for (size_t i = 0; i < nodes.size(); ++i) {
      for (size_t ahead = i; i % kAtOnce == 0 && ahead < std::min(i + kAtOnce, nodes.size());
           ++ahead) {
        unit.cluster.positions.Prefetch(unit.cluster.external_vertices() + nodes[ahead]);
        __builtin_prefetch(&d.reaches[nodes[ahead]]);
        __builtin_prefetch(&unit.cluster.error_codes[nodes[ahead]]);
      }
      const NodeIndex node = nodes[i];
      const bool asks = d.nodes[node] != kPassed && d.reaches[node] != 0;
      if (asks && stands(node)) continue;
      nodes[left++] = node;
      if (std::isnan(d.nodes[node])) d.nodes[node] = kPassed;
    }
    nodes.resize(left);
  };
  look(expired_.nodes, [&](NodeIndex node) {
    const Box3d around = BoxAround(u, unit, node);
    return (!std::isnan(d.nodes[node]) &&
            Stands(u, around, node, unit.cluster.error_codes[node])) ||
           StaysNear(u, around, node, moved);
  });
  look(expired_.sides, [&](NodeIndex node) {
    const Box3d around = BoxAround(u, unit, node);
    return StaysAside(u, around, node) || StaysNear(u, around, node, moved);
  });
  expired_.nodes.insert(expired_.nodes.end(), expired_.sides.begin(), expired_.sides.end());
  expired_.sides.clear();
  std::erase_if(d.mixed, [&](const UnitDeadlines::Mixed& m) { return d.nodes[m.node] == kPassed; });
  return expired_;
}

Box3d Deadlines::BoxAround(const MovingUnit& u, const LoadedUnit& unit, NodeIndex node) const {
  const int64_t reach = u.deadlines.reaches[node];
  const Vec3i at = unit.cluster.position(unit.cluster.first_vertex(node));
  Box3i around = units_.index().unit(u.id).bounds;
  for (int i = 0; i < 3; ++i) {
    around.min[i] = static_cast<int32_t>(std::max<int64_t>(around.min[i], at[i] - reach));
    around.max[i] = static_cast<int32_t>(std::min<int64_t>(around.max[i], at[i] + reach));
  }
  return judge_.ModelBox(around);
}

bool Deadlines::StaysAside(MovingUnit& u, const Box3d& around, NodeIndex node) const {
  UnitDeadlines& d = u.deadlines;
  const float side = Until(d, judge_.WhereIs(around, d.reach));
  if (side == 0 || (side > 0) != (d.sides[node] > 0)) return false;
  SetSide(d, node, side);
  return true;
}

bool Deadlines::StaysNear(MovingUnit& u, const Box3d& around, NodeIndex node,
                          const Moved& moved) const {
  UnitDeadlines& d = u.deadlines;
  const bool of_shift = d.shifted && !d.node_shifts.empty() && Up(d.shift) >= d.node_shifts[node];
  const float side = d.sides.empty() ? kNotAsked : d.sides[node];
  const bool of_side = d.shifted && side != 0 && Up(d.shift) >= std::abs(side);
  if (!of_shift && !of_side) return false;
  const float deadline = d.nodes[node];
  const bool of_field =
      u.refusing.Test(node) ? d.rose && Up(d.high) >= deadline : d.fell && Down(d.low) <= deadline;
  if (of_field || !judge_.meter().Spend(1)) return false;
  FieldChange change{{0, 0}};
  if (moved.threshold) change = ChangeIn(u, around, *moved.from);
  if (!std::isfinite(change.low) || !std::isfinite(change.high)) return false;
  double shift = change.shift;
  if (moved.region && d.activity == Activity::kSome) {
    shift = std::max(shift, moved.from_region->Shift(*judge_.region(), around));
  }
  const auto left = [&](float until) { return std::abs(until) - d.shift_before - shift; };
  if (shift > 0 && of_shift && !(left(d.node_shifts[node]) > 0)) return false;
  if (shift > 0 && of_side && !(left(side) > 0)) return false;
  const auto later = [&](float until) { return Down(d.shift + std::max(left(until), 0.0)); };
  if (of_shift) SetShift(d, node, later(d.node_shifts[node]));
  if (of_side) SetSide(d, node, std::copysign(later(side), side));
  return true;
}

bool Deadlines::Stands(MovingUnit& u, const Box3d& around, NodeIndex node, uint8_t code) const {
  UnitDeadlines& d = u.deadlines;
  const bool refuses = u.refusing.Test(node);
  if (refuses && !u.applied.Test(node)) return false;
  if (!d.sides.empty() && d.sides[node] == 0) return false;
  const double bound = judge_.Bound(code);
  const double shift = d.margin > 0 ? kInfinity : judge_.MarginIn(around, bound);
  float side = kNotAsked;
  Activity activity = d.activity;
  if (activity == Activity::kSome) {
    side = Until(d, judge_.WhereIs(around, d.reach));
    activity = SideToActivity(side);
  }
  Leeway leeway{kInfinity, kInfinity, shift};
  if (activity == Activity::kNone) {
    if (refuses) return false;
  } else {
    const ErrorRange range = judge_.FieldOf(u.id).Range(around, bound);
    if (refuses && !(activity == Activity::kAll && bound > range.high)) return false;
    if (!refuses && !(bound <= range.low)) return false;
    refuses ? leeway.rise = bound - range.high : leeway.fall = range.low - bound;
  }
  SetLeeway(d, node, refuses, leeway);
  SetSide(d, node, side);
  return true;
}

void Deadlines::SetLeeway(UnitDeadlines& d, NodeIndex node, bool refuses, const Leeway& leeway) {
  SetNode(d, node, refuses, refuses ? Down(d.high + leeway.rise) : Up(d.low - leeway.fall));
  SetShift(d, node, Down(d.shift + leeway.shift));
}

// First by the range of the threshold around all of the unit, then around the hole, then triangle
// by triangle.
Deadlines::Verdict Deadlines::Look(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  const UnitDeadlines& d = u.deadlines;
  const double bound = judge_.Bound(unit.cluster.error_codes[node]);
  if (d.activity == Activity::kNone) return {};
  judge_.meter().Spend(1);
  const double good = GoodMargin(d.range);
  Box3i hole;
  Box3d box;
  const auto find_box = [&] {
    hole = unit.hole_bounds(node);
    box = judge_.ModelBox(hole);
  };
  double shift = kInfinity;  // of borders
  if (d.margin <= 0) {
    find_box();
    shift = judge_.MarginIn(box, bound);
  }
  SetSide(u.deadlines, node, kNotAsked);
  if (d.range.low - bound >= good) return {false, false, {d.range.low - bound, kInfinity, shift}};
  if (d.activity == Activity::kAll && bound - d.range.high >= good && bound > d.range.high) {
    return {true, true, {kInfinity, bound - d.range.high, shift}};
  }
  Activity activity = d.activity;
  if (activity == Activity::kSome) {
    FindSide(judge_, u.deadlines, unit, node);
    activity = SideToActivity(d.sides[node]);
  }
  if (activity == Activity::kNone) return {};
  if (d.margin > 0) find_box();
  if (activity == Activity::kSome) {
    const Judge::Where where = judge_.WhereIs(box, bound);
    activity = where.activity;
    if (activity == Activity::kNone) return {false, false, {kInfinity, kInfinity, where.shift}};
    shift = std::min(shift, activity == Activity::kAll ? where.shift : Length(box.max - box.min));
  } else if (d.reaches[node] == 0) {
    for (const uint32_t local : unit.cluster.created_vertices(node)) {
      hole.Add(unit.cluster.position(local));
    }
    SetReach(u.deadlines, unit, node, hole);
  }
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

double Deadlines::ActiveLeeway(const Triangle3d& t, double bound, bool active, double most) const {
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

bool Deadlines::Evaluate(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  ++evaluated_;
  UnitDeadlines& d = u.deadlines;
  const Verdict verdict = Look(u, unit, node);
  const bool mixed = verdict.some && !verdict.all;
  const Leeway& leeway = verdict.leeway;
  SetLeeway(d, node, verdict.some, leeway);
  if (mixed) {
    d.nodes[node] = kMixed;
    d.mixed.push_back({node, Up(d.low - leeway.fall), Down(d.high + leeway.rise)});
  }
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
  SetNode(d, node, false, valid ? Up(d.low - fall) : kPassed);
  SetShift(d, node, kInfinity);
  SetSide(d, node, kNotAsked);
  evaluated_ += valid ? 1 : 0;
  return !valid;
}

void Deadlines::Forget(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  units_.Save(u);
  SetNode(u.deadlines, node, false, kNever);
  SetShift(u.deadlines, node, kInfinity);
  SetSide(u.deadlines, node, kNotAsked);
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
  SetShiftAt(&d.child_shifts, d.children.size(), ordinal,
             known ? Down(d.shift + leeway.shift) : kInfinity);
}

void Deadlines::AddChild(MovingUnit& u, uint32_t ordinal, const Leeway& leeway) {
  UnitDeadlines& d = u.deadlines;
  d.children[ordinal] = std::max(d.children[ordinal], Up(d.low - leeway.fall));
  const float before = d.child_shifts.empty() ? kInfinity : d.child_shifts[ordinal];
  SetShiftAt(&d.child_shifts, d.children.size(), ordinal,
             std::min(before, Down(d.shift + leeway.shift)));
}

void Deadlines::SetChildWaits(MovingUnit& u, uint32_t ordinal) {
  u.deadlines.children[ordinal] = kPassed;
}

}  // namespace mtdb::internal
