// SPDX-License-Identifier: Apache-2.0
#include "query/moving/unit_deadlines.h"

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

namespace mtdb::internal {
namespace {

// Of 64 deadlines the first one by `before` that is beyond `limit`, which Mixed() is not; else
// `none`. In eight lanes.
template <typename At, typename Before>
Deadline First(At&& at, float limit, float none, Before&& before) {
  constexpr size_t kLanes = 8;
  std::array<float, kLanes> first;
  first.fill(none);
  for (size_t i = 0; i < 64; i += kLanes) {
    for (size_t l = 0; l < kLanes; ++l) {
      const float v = before(limit, at(i + l)) ? at(i + l) : none;
      first[l] = before(v, first[l]) ? v : first[l];
    }
  }
  for (const float f : first) none = before(f, none) ? f : none;
  return Deadline(none);
}
Deadline FirstBelow(const Deadline* deadlines, float limit) {
  return First([&](size_t i) { return deadlines[i].at(); }, limit, Deadline::NeverFallen().at(),
               [](float a, float b) { return a > b; });
}
template <typename At>
Deadline FirstAbove(At&& at, float limit) {
  return First(at, limit, Deadline::NeverRisen().at(), [](float a, float b) { return a < b; });
}
Deadline FirstAbove(const Deadline* deadlines, float limit) {
  return FirstAbove([&](size_t i) { return deadlines[i].at(); }, limit);
}

Deadline SoonerFallen(Deadline a, Deadline b) { return a.at() < b.at() ? b : a; }
Deadline SoonerRisen(Deadline a, Deadline b) { return b.at() < a.at() ? b : a; }

// An empty list says that no border matters.
void SetShiftAt(std::vector<Deadline>* shifts, size_t size, size_t at, Deadline shift) {
  if (shifts->empty()) {
    if (shift.at() == Deadline::NeverRisen().at()) return;
    shifts->assign(size, Deadline::NeverRisen());
  }
  (*shifts)[at] = shift;
}

}  // namespace

UnitBounds::UnitBounds(const Judge& judge, UnitId unit)
    : box(judge.ModelBox(judge.index().unit(unit).bounds)), reach(judge.Reach(unit)) {
  FindRanges(judge, unit);
  margin = judge.MarginIn(box, reach);
  activity = judge.ActivityIn(box, reach);
}

void UnitBounds::FindRanges(const Judge& judge, UnitId unit) {
  child_range = judge.RangeIn(box, reach);
  const bool same = &judge.FieldOf(unit) == judge.threshold().get();
  range = same ? child_range : judge.RangeOf(unit, box, reach);
}

void ChangeSum::Add(const FieldChange& change) {
  low += change.low;
  high += change.high;
  shift_before = shift;
  shift += change.shift;
  fell = change.low < 0;
  rose = change.high > 0;
  shifted = change.shift > 0;
}

void UnitDeadlines::Begin(const UnitBounds& of_unit, const Bits& nodes, size_t children) {
  stale = false;
  bounds = of_unit;
  nodes_.assign(nodes.size(), Deadline::NeverFallen());
  children_.assign(children, Deadline::NeverFallen());
  reaches_.assign(nodes.size(), 0);
  soonest_.assign(nodes.words().size(), {});
  node_shifts_.clear();
  child_shifts_.clear();
  sides_.clear();
}

void UnitDeadlines::BeginSum() {
  sum.low = sum.high = sum.shift = 0;
  node_shifts_.clear();
  child_shifts_.clear();
  sides_.clear();
}

void UnitDeadlines::TakeExpired(const Bits& known, const Bits& refusing, Expired* expired) {
  if (expired->all) {
    known.ForEach([&](NodeIndex node) { expired->nodes.push_back(node); });
    nodes_.assign(nodes_.size(), Deadline::NeverFallen());
    soonest_.assign(soonest_.size(), {});
    mixed_.clear();
  } else {
    TakeExpiredNodes(known, refusing, expired);
    TakeExpiredMixed(expired);
  }
  const float low = sum.fallen();
  const float shift = sum.shifts();
  for (uint32_t c = 0; c < children_.size(); ++c) {
    const bool shifted = sum.shifted && !child_shifts_.empty() && child_shifts_[c].HasRisen(shift);
    if (!expired->all && !children_[c].HasFallen(low) && !shifted) continue;
    children_[c] = Deadline::NeverFallen();
    if (!child_shifts_.empty()) child_shifts_[c] = Deadline::NeverRisen();
    expired->children.push_back(c);
  }
}

// What did not fall passes no deadline of `low`, and likewise for the others: no need to look.
// Since `low` is not above `high`, of what has not passed only deadlines of `low` are below it, and
// only those of `high` above that.
void UnitDeadlines::TakeExpiredNodes(const Bits& known, const Bits& refusing, Expired* expired) {
  const float low = sum.fallen();
  const float high = sum.risen();
  const float shift = sum.shifts();
  const auto add = [](uint32_t word, uint64_t rest, std::vector<NodeIndex>* nodes) {
    for (; rest != 0; rest &= rest - 1) {
      nodes->push_back(word * 64 + static_cast<uint32_t>(std::countr_zero(rest)));
    }
  };
  for (uint32_t w = 0; w < soonest_.size(); ++w) {
    Soonest& soonest = soonest_[w];
    const size_t first = size_t{w} * 64;
    const Deadline* const at = nodes_.data() + first;
    uint64_t nodes = 0;
    uint64_t sides = 0;
    if (sum.fell && soonest.low.HasFallen(low)) {
      nodes |= ~refusing.words()[w] & BitsWhere(at, [&](Deadline d) { return d.HasFallen(low); });
      soonest.low = FirstBelow(at, low);
    }
    if (sum.rose && soonest.high.HasRisen(high)) {
      nodes |= refusing.words()[w] & BitsWhere(at, [&](Deadline d) { return d.HasRisen(high); });
      soonest.high = FirstAbove(at, high);
    }
    if (sum.shifted && soonest.shift.HasRisen(shift)) {
      const Deadline* const shifts = node_shifts_.data() + first;
      nodes |= BitsWhere(shifts, [&](Deadline d) { return d.HasRisen(shift); });
      soonest.shift = FirstAbove(shifts, shift);
    }
    if (sum.shifted && soonest.side.HasRisen(shift)) {
      const Side* const of = sides_.data() + first;
      sides = BitsWhere(of, [&](Side s) { return s.HasPassed(shift); });
      soonest.side = FirstAbove([&](size_t i) { return of[i].until().at(); }, shift);
    }
    add(w, known.words()[w] & nodes, &expired->nodes);
    add(w, known.words()[w] & sides & ~nodes, &expired->sides);
  }
}

void UnitDeadlines::TakeExpiredMixed(Expired* expired) {
  const float low = sum.fallen();
  const float high = sum.risen();
  const float shift = sum.shifts();
  std::erase_if(mixed_, [&](const Mixed& m) {
    if (!m.low.HasFallen(low) && !m.high.HasRisen(high)) return false;
    nodes_[m.node] = Deadline::Passed();
    const bool found =
        sum.shifted && (this->shift(m.node).HasRisen(shift) || side(m.node).HasPassed(shift));
    if (!found) expired->nodes.push_back(m.node);
    return true;
  });
}

void UnitDeadlines::SetNode(NodeIndex node, bool refuses, Deadline deadline) {
  nodes_[node] = deadline;
  Soonest& soonest = soonest_[node / 64];
  if (refuses) {
    soonest.high = SoonerRisen(soonest.high, deadline);
  } else {
    soonest.low = SoonerFallen(soonest.low, deadline);
  }
}

void UnitDeadlines::SetLeeway(NodeIndex node, bool refuses, const Leeway& leeway) {
  SetNode(
      node, refuses,
      refuses ? Deadline::Risen(sum.high + leeway.rise) : Deadline::Fallen(sum.low - leeway.fall));
  SetShift(node, Deadline::Risen(sum.shift + leeway.shift));
}

void UnitDeadlines::SetMixed(NodeIndex node, const Leeway& leeway) {
  SetLeeway(node, true, leeway);
  nodes_[node] = Deadline::Mixed();
  mixed_.push_back(
      {node, Deadline::Fallen(sum.low - leeway.fall), Deadline::Risen(sum.high + leeway.rise)});
}

void UnitDeadlines::DropPassedMixed() {
  std::erase_if(mixed_, [&](const Mixed& m) { return nodes_[m.node].passed(); });
}

void UnitDeadlines::SetShift(NodeIndex node, Deadline shift) {
  SetShiftAt(&node_shifts_, nodes_.size(), node, shift);
  Deadline& soonest = soonest_[node / 64].shift;
  soonest = SoonerRisen(soonest, shift);
}

void UnitDeadlines::SetSide(NodeIndex node, Side side) {
  if (sides_.empty()) {
    if (!side.asked()) return;
    sides_.assign(nodes_.size(), Side());
  }
  sides_[node] = side;
  Deadline& soonest = soonest_[node / 64].side;
  if (!side.at_border()) soonest = SoonerRisen(soonest, side.until());  // not asked: it stays
}

// Rounded down, so that it is not 0.
Side UnitDeadlines::SideFrom(const Judge::Where& where) const {
  const double until = (sum.shift + where.shift) * (1 - 1e-6);
  if (!(until > sum.shift)) return {Activity::kSome, 0};
  return {where.activity, static_cast<float>(until)};
}

void UnitDeadlines::SetReach(const LoadedUnit& unit, NodeIndex node, const Box3i& box) {
  const IndexRange created = unit.cluster.created_vertices(node);
  if (created.size() == 0) return;
  const Vec3i at = unit.cluster.position(*created.begin());
  int64_t reach = 1;
  for (int i = 0; i < 3; ++i) {
    reach = std::max({reach, int64_t{box.max[i]} - at[i], int64_t{at[i]} - box.min[i]});
  }
  reaches_[node] = static_cast<uint16_t>(reach > 0xffff ? 0 : reach);
}

void UnitDeadlines::SetChild(uint32_t ordinal, const Leeway& leeway) {
  const bool known = leeway.fall >= 0;
  children_[ordinal] = known ? Deadline::Fallen(sum.low - leeway.fall) : Deadline::NeverFallen();
  SetShiftAt(&child_shifts_, children_.size(), ordinal,
             known ? Deadline::Risen(sum.shift + leeway.shift) : Deadline::NeverRisen());
}

void UnitDeadlines::AddChild(uint32_t ordinal, const Leeway& leeway) {
  children_[ordinal] = SoonerFallen(children_[ordinal], Deadline::Fallen(sum.low - leeway.fall));
  const Deadline before = child_shifts_.empty() ? Deadline::NeverRisen() : child_shifts_[ordinal];
  SetShiftAt(&child_shifts_, children_.size(), ordinal,
             SoonerRisen(before, Deadline::Risen(sum.shift + leeway.shift)));
}

}  // namespace mtdb::internal
