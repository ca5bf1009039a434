// SPDX-License-Identifier: Apache-2.0
#include "query/moving/deadlines.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace mtdb::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

bool IsFinite(const FieldChange& change) {
  return std::isfinite(change.low) && std::isfinite(change.high) && std::isfinite(change.shift);
}

}  // namespace

const Expired& Deadlines::Advance(MovingUnit& u, const Moved& moved) {
  UnitDeadlines& d = u.deadlines;
  UnitBounds& bounds = d.bounds;
  expired_.nodes.clear();
  expired_.sides.clear();
  expired_.children.clear();
  bool& all = expired_.all;
  all = d.stale;
  if (all || moved.region) {
    const Activity activity = judge_.ActivityIn(bounds.box, bounds.reach);
    all |= std::exchange(bounds.activity, activity) != activity;
  }
  // What a border does in a unit is counted while one is there.
  const bool was_clear =
      std::exchange(bounds.margin, judge_.MarginIn(bounds.box, bounds.reach)) > 0;
  all |= was_clear && bounds.margin <= 0;
  if (!all) all = !AddChange(u, moved, was_clear);
  bounds.FindRanges(judge_, u.id);
  d.stale = false;
  if (all) d.BeginSum();
  // Else nothing was or is active there.
  if (all || bounds.activity != Activity::kNone) d.TakeExpired(u.known, u.refusing, &expired_);
  return expired_;
}

FieldChange Deadlines::ChangeIn(const MovingUnit& u, const Box3d& box,
                                const Judge::Fields& from) const {
  const auto between = [&](const Threshold& a, const Threshold& b) {
    return &a == &b ? FieldChange{{0, 0}} : a.Change(b, box, u.deadlines.bounds.reach);
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
  const UnitBounds& bounds = u.deadlines.bounds;
  FieldChange change{{0, 0}};
  if (moved.threshold) change = ChangeIn(u, bounds.box, *moved.from);
  if (was_clear) change.shift = 0;
  if (moved.region && bounds.activity == Activity::kSome) {
    change.shift = std::max(change.shift, moved.from_region->Shift(*judge_.region(), bounds.box));
  }
  if (!IsFinite(change)) return false;
  u.deadlines.sum.Add(change);
  return true;
}

const Expired& Deadlines::LookAround(MovingUnit& u, const LoadedUnit& unit, const Moved& moved) {
  if (expired_.all) return expired_;
  UnitDeadlines& d = u.deadlines;
  // Keeps those that do not stand. They are in the list of mixed ones no more.
  const auto look = [&](std::vector<NodeIndex>& nodes, auto stands) {
    constexpr size_t kAtOnce = 32;
    size_t left = 0;
    for (size_t i = 0; i < nodes.size(); ++i) {
      for (size_t ahead = i; i % kAtOnce == 0 && ahead < std::min(i + kAtOnce, nodes.size());
           ++ahead) {
        unit.cluster.positions.Prefetch(unit.cluster.external_vertices() + nodes[ahead]);
        d.Prefetch(nodes[ahead]);
        __builtin_prefetch(&unit.cluster.error_codes[nodes[ahead]]);
      }
      const NodeIndex node = nodes[i];
      const bool asks = !d.node(node).passed() && d.reach(node) != 0;
      if (asks && stands(node)) continue;
      nodes[left++] = node;
      if (d.node(node).mixed()) d.SetPassed(node);
    }
    nodes.resize(left);
  };
  look(expired_.nodes, [&](NodeIndex node) {
    const Box3d around = BoxAround(u, unit, node);
    return (!d.node(node).mixed() && Stands(u, around, node, unit.cluster.error_codes[node])) ||
           StaysNear(u, around, node, moved);
  });
  look(expired_.sides, [&](NodeIndex node) {
    const Box3d around = BoxAround(u, unit, node);
    return StaysAside(u, around, node) || StaysNear(u, around, node, moved);
  });
  expired_.nodes.insert(expired_.nodes.end(), expired_.sides.begin(), expired_.sides.end());
  expired_.sides.clear();
  d.DropPassedMixed();
  return expired_;
}

Box3d Deadlines::BoxAround(const MovingUnit& u, const LoadedUnit& unit, NodeIndex node) const {
  const int64_t reach = u.deadlines.reach(node);
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
  const Side side = d.SideFrom(judge_.WhereIs(around, d.bounds.reach));
  if (side.at_border() || side.activity() != d.side(node).activity()) return false;
  d.SetSide(node, side);
  return true;
}

bool Deadlines::StaysNear(MovingUnit& u, const Box3d& around, NodeIndex node,
                          const Moved& moved) const {
  UnitDeadlines& d = u.deadlines;
  const ChangeSum& sum = d.sum;
  const Deadline at = d.shift(node);
  const Side side = d.side(node);
  const bool of_shift = sum.shifted && at.HasRisen(sum.shifts());
  const bool of_side = sum.shifted && side.HasPassed(sum.shifts());
  if (!of_shift && !of_side) return false;
  if (d.NodeHasPassed(node, u.refusing.Test(node)) || !judge_.meter().Spend(1)) return false;
  FieldChange change{{0, 0}};
  if (moved.threshold) change = ChangeIn(u, around, *moved.from);
  if (!std::isfinite(change.low) || !std::isfinite(change.high)) return false;
  double shift = change.shift;
  if (moved.region && d.bounds.activity == Activity::kSome) {
    shift = std::max(shift, moved.from_region->Shift(*judge_.region(), around));
  }
  const auto left = [&](Deadline until) { return until.at() - sum.shift_before - shift; };
  if (shift > 0 && of_shift && !(left(at) > 0)) return false;
  if (shift > 0 && of_side && !(left(side.until()) > 0)) return false;
  const auto later = [&](Deadline until) {
    return Deadline::Risen(sum.shift + std::max(left(until), 0.0));
  };
  if (of_shift) d.SetShift(node, later(at));
  if (of_side) d.SetSide(node, {side.activity(), later(side.until()).at()});
  return true;
}

bool Deadlines::Stands(MovingUnit& u, const Box3d& around, NodeIndex node, uint8_t code) const {
  UnitDeadlines& d = u.deadlines;
  const bool refuses = u.refusing.Test(node);
  if (refuses && !u.applied.Test(node)) return false;
  if (d.side(node).at_border()) return false;
  const double bound = judge_.Bound(code);
  const double shift = d.bounds.margin > 0 ? kInfinity : judge_.MarginIn(around, bound);
  Side side;
  Activity activity = d.bounds.activity;
  if (activity == Activity::kSome) {
    side = d.SideFrom(judge_.WhereIs(around, d.bounds.reach));
    activity = side.activity();
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
  d.SetLeeway(node, refuses, leeway);
  d.SetSide(node, side);
  return true;
}

}  // namespace mtdb::internal
