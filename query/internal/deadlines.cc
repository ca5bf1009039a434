// SPDX-License-Identifier: Apache-2.0
#include "query/internal/deadlines.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

namespace mtdb::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr float kNever = -std::numeric_limits<float>::infinity();  // as a deadline of `low`

// As deadlines: what is at least, at most the value.
float Up(double value) {
  const auto f = static_cast<float>(value);
  return f < value ? std::nextafter(f, -kNever) : f;
}
float Down(double value) {
  const auto f = static_cast<float>(value);
  return f > value ? std::nextafter(f, kNever) : f;
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
  d.range = judge.RangeIn(d.box, d.reach);
  d.activity = judge.ActivityIn(d.box, d.reach);
  d.stale = false;
  d.nodes.assign(u.known.size(), kNever);
  d.children.assign(index.children(u.id).size(), kNever);
}

const Deadlines::Expired& Deadlines::Advance(MovingUnit& u, const Moved& moved) {
  UnitDeadlines& d = u.deadlines;
  expired_.nodes.clear();
  expired_.children.clear();
  bool& all = expired_.all;
  all = d.stale;
  if (all || moved.region) {
    const Activity was = std::exchange(d.activity, judge_.ActivityIn(d.box, d.reach));
    all |= was != d.activity || d.activity == Activity::kSome;
  }
  if (moved.threshold && !all) {
    const ErrorRange change = moved.from->Change(*judge_.threshold(), d.box, d.reach);
    all = !std::isfinite(change.low) || !std::isfinite(change.high);
    d.low += change.low;
    d.high += change.high;
    d.fell = change.low < 0;
    d.rose = change.high > 0;
  }
  d.range = judge_.RangeIn(d.box, d.reach);
  d.stale = false;
  if (all) d.low = d.high = 0;
  // Else nothing was or is active there.
  if (all || d.activity != Activity::kNone) FindExpired(u);
  return expired_;
}

// What did not fall passes no deadline of `low`, and likewise for `high`: no need to look.
void Deadlines::FindExpired(MovingUnit& u) {
  UnitDeadlines& d = u.deadlines;
  const bool all = expired_.all;
  const float low = Down(d.low);
  const float high = Up(d.high);
  for (uint32_t w = 0; w < u.known.words().size(); ++w) {
    uint64_t rest = u.known.words()[w];
    if (!all) {
      const float* const deadlines = d.nodes.data() + size_t{w} * 64;
      const uint64_t refusing = u.refusing.words()[w];
      const uint64_t may_fall = d.fell ? rest & ~refusing : 0;
      const uint64_t may_rise = d.rose ? rest & refusing : 0;
      rest = 0;
      std::array<uint8_t, 64> passed;
      if (may_fall != 0) {
        for (size_t i = 0; i < 64; ++i) passed[i] = low <= deadlines[i] ? 1 : 0;
        rest |= Bits::PackWord(passed.data()) & may_fall;
      }
      if (may_rise != 0) {
        for (size_t i = 0; i < 64; ++i) passed[i] = high >= deadlines[i] ? 1 : 0;
        rest |= Bits::PackWord(passed.data()) & may_rise;
      }
    }
    for (; rest != 0; rest &= rest - 1) {
      expired_.nodes.push_back(w * 64 + static_cast<uint32_t>(std::countr_zero(rest)));
    }
  }
  std::erase_if(d.mixed, [&](const UnitDeadlines::Mixed& m) {
    if (!all && low > m.low && high < m.high) return false;
    if (!all) expired_.nodes.push_back(m.node);
    return true;
  });
  for (uint32_t c = 0; c < d.children.size(); ++c) {
    if (!all && low > d.children[c]) continue;
    d.children[c] = kNever;
    expired_.children.push_back(c);
  }
}

// First by the range of the threshold around all of the unit, then around the hole, then triangle
// by triangle.
Deadlines::Verdict Deadlines::Look(const MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  const UnitDeadlines& d = u.deadlines;
  const double bound = judge_.Bound(unit.cluster.error_codes[node]);
  if (d.activity == Activity::kNone) return {false, false, kInfinity, kInfinity};
  judge_.meter().Spend(1);
  const double good = GoodMargin(d.range);
  if (d.range.low - bound >= good) return {false, false, d.range.low - bound, kInfinity};
  if (d.activity == Activity::kAll && bound - d.range.high >= good && bound > d.range.high) {
    return {true, true, kInfinity, bound - d.range.high};
  }
  const Box3d box = judge_.ModelBox(unit.hole_bounds(node));
  const Activity activity =
      d.activity == Activity::kAll ? Activity::kAll : judge_.ActivityIn(box, bound);
  if (activity == Activity::kNone) return {false, false, kInfinity, kInfinity};
  const ErrorRange range = judge_.threshold()->Range(box, bound);
  if (bound <= range.low) return {false, false, range.low - bound, kInfinity};
  if (activity == Activity::kAll && bound > range.high) {
    return {true, true, kInfinity, bound - range.high};
  }
  return LookAtTriangles(unit, node, activity == Activity::kAll);
}

Deadlines::Verdict Deadlines::LookAtTriangles(const LoadedUnit& unit, NodeIndex node,
                                              bool all_active) {
  const double bound = judge_.Bound(unit.cluster.error_codes[node]);
  const std::span<const LocalNumber> hole = unit.cluster.hole(node);
  refused_.assign(hole.size(), false);
  Verdict verdict{false, true, kInfinity, kInfinity};
  for (size_t i = 0; i < hole.size(); ++i) {
    if (!judge_.meter().Spend(1)) break;
    const Triangle3d t = judge_.Corners(unit, hole[i], unit.creator(hole[i]));
    const bool active = all_active || judge_.Active(t, bound);
    const double least = active ? judge_.threshold()->Min(t, bound) : kInfinity;
    if (bound <= least) {
      verdict.all = false;
      verdict.fall = std::min(verdict.fall, least - bound);
    } else {
      verdict.some = refused_[i] = true;
      verdict.rise = std::min(verdict.rise, bound - least);
    }
  }
  return verdict;
}

bool Deadlines::Evaluate(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  ++evaluated_;
  UnitDeadlines& d = u.deadlines;
  const Verdict verdict = Look(u, unit, node);
  const bool mixed = verdict.some && !verdict.all;
  const float low = Up(d.low - verdict.fall);
  const float high = Down(d.high + verdict.rise);
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
  const ErrorRange& range = u.deadlines.range;
  // Most are valid by far, and their code says so.
  const double fall = range.low - judge_.Bound(code);
  const bool valid = fall >= GoodMargin(range);
  u.deadlines.nodes[node] = valid ? Up(u.deadlines.low - fall) : kPassed;
  evaluated_ += valid ? 1 : 0;
  return !valid;
}

void Deadlines::Forget(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  units_.Save(u);
  u.known.Clear(node);
  u.refusing.Clear(node);
  u.refused.ClearRange(unit.cluster.hole_begin[node], unit.cluster.hole_begin[node + 1]);
}

double Deadlines::Margin(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot,
                         uint8_t code) const {
  const UnitDeadlines& d = u.deadlines;
  const double bound = judge_.Bound(code);
  if (d.activity == Activity::kNone || !judge_.meter().Spend(1)) return kInfinity;
  if (bound <= d.range.low) return d.range.low - bound;
  if (d.activity == Activity::kAll && bound > d.range.high) return -1;
  const Triangle3d t = judge_.Corners(unit, slot, unit.creator(slot));
  if (d.activity == Activity::kSome && !judge_.Active(t, bound)) return kInfinity;
  const double least = judge_.threshold()->Min(t, bound);
  return bound <= least ? least - bound : -1;
}

double Deadlines::ChildMargin(UnitId child) const {
  constexpr double kGoodShare = 0.1;  // of the range of Min; less says too little
  const double bound = judge_.Bound(units_.LargestCode(child));
  const ErrorRange range =
      judge_.RangeIn(judge_.ModelBox(units_.index().unit(child).bounds), bound);
  const double fall = range.low - bound;
  return fall >= kGoodShare * (range.high - range.low) ? fall : -1;
}

void Deadlines::SetChild(MovingUnit& u, uint32_t ordinal, double margin) {
  u.deadlines.children[ordinal] = margin < 0 ? kNever : Up(u.deadlines.low - margin);
}

void Deadlines::AddChild(MovingUnit& u, uint32_t ordinal, double margin) {
  float& deadline = u.deadlines.children[ordinal];
  deadline = std::max(deadline, Up(u.deadlines.low - margin));
}

void Deadlines::SetChildWaits(MovingUnit& u, uint32_t ordinal) {
  u.deadlines.children[ordinal] = kPassed;
}

}  // namespace mtdb::internal
