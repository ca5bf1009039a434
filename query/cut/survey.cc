// SPDX-License-Identifier: Apache-2.0
#include "query/cut/survey.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

namespace mtdb::internal {

Result<ActiveTriangles> Survey::Run(bool complete, const Box3d& bounds) {
  if (!Begin(complete, bounds)) MTDB_RETURN_IF_ERROR(SurveyUnits(complete));
  return active_;
}

bool Survey::Begin(bool complete, const Box3d& bounds) {
  active_.all = judge_.whole();
  falls_short_ = !complete || MayFallShort(judge_.asked(), bounds, judge_.rounding());
  if (falls_short_ && judge_.by_code() && complete) {
    // All triangles have the same bound.
    active_.shortfall = {cut_.counts().triangles, judge_.rounding() - *judge_.asked()->constant(),
                         bounds};
    falls_short_ = false;
  }
  if (!CodesOnly()) return false;
  active_.count = cut_.counts().triangles;
  if (!cut_.remembers()) return false;
  active_.largest_code = cut_.counts().LargestCode();
  return true;
}

Status Survey::SurveyUnits(bool complete) {
  for (const UnitId id : cut_.open()) {
    CutUnit& u = *cut_.Find(id);
    if (u.present.empty()) continue;
    if (CodesOnly()) {
      if (complete && active_.largest_code == judge_.valid_code()) break;
      MTDB_RETURN_IF_ERROR(pins_.RunOn(u, [&](const LoadedUnit& unit) {
        FindLargestCode(u, unit);
        return Status::Ok();
      }));
      continue;
    }
    const Box3d box = judge_.ModelBox(cut_.index().unit(id).bounds);
    const double reach = judge_.Reach(id);
    In in{judge_.ActivityIn(box, reach), -std::numeric_limits<double>::infinity()};
    if (in.activity == Activity::kNone) continue;
    if (falls_short_) {
      const Threshold& asked = judge_.asked() == nullptr ? *FullResolution() : *judge_.asked();
      const ErrorRange range = asked.Range(box, reach);
      in.least = range.low;
      in.most = range.high;
    }
    // Where a border makes codes tell little, stars tell more.
    const bool by_codes = !StarsTellMore(u) || in.most < judge_.rounding();
    const bool counts =
        in.activity == Activity::kAll && falls_short_ && by_codes && (!marks_ || active_.all);
    MTDB_RETURN_IF_ERROR(pins_.RunOn(u, [&](const LoadedUnit& unit) {
      counts ? CountShort(u, unit, in) : SurveyUnit(u, unit, in);
      return Status::Ok();
    }));
  }
  return Status::Ok();
}

int Survey::CodeOf(const LoadedUnit& unit, uint32_t slot) const {
  const uint32_t remover = unit.removers()[slot];
  if (RemovedByNode(remover)) return unit.cluster.error_codes[remover];
  if (remover == kDrain) return 0;
  const UnitId child = unit.children()[ChildOrdinal(remover)];
  return cut_.Looked(child) ? -1 : cut_.LargestCode(child);
}

void Survey::FindLargestCode(const CutUnit& u, const LoadedUnit& unit) {
  const NodeIndex nodes = cut_.LargestCode(u.id) > active_.largest_code ? unit.nodes() : 0;
  for (NodeIndex node = 0; node < nodes; ++node) {
    const uint8_t code = unit.cluster.error_codes[node];
    if (code <= active_.largest_code || u.applied.Test(node)) continue;
    if (cut_.AnyPresent(u, unit, node)) active_.largest_code = code;
  }
  if (LargestOfChildren(u.id) <= active_.largest_code) return;
  u.present.ForEach([&](uint32_t own) {
    const uint32_t slot = own + u.first_own;
    if (!RemovedByChild(unit.removers()[slot])) return;
    if (const int code = CodeOf(unit, slot); code > active_.largest_code) {
      active_.largest_code = static_cast<uint8_t>(code);
    }
  });
}

bool Survey::Count(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code,
                   const In& in) {
  const double bound = judge_.Bound(code);
  const bool looks = in.activity == Activity::kSome || (falls_short_ && !(in.least > bound));
  const Triangle3d t = looks ? judge_.Corners(unit, slot, creator) : Triangle3d{};
  if (in.activity == Activity::kSome && !judge_.Active(t, bound)) return false;
  ++active_.count;
  active_.largest_code = std::max(active_.largest_code, code);
  if (falls_short_ && !(in.least > bound) && judge_.meter().Spend(1)) {
    const Threshold& asked = judge_.asked() == nullptr ? *FullResolution() : *judge_.asked();
    AddShortfall(asked, t, bound, unit.removers()[slot] != kDrain, &active_.shortfall);
  }
  return true;
}

// Where all are active. Most codes tell whether a triangle falls short, and by how much at most;
// the others are looked at.
void Survey::CountShort(CutUnit& u, const LoadedUnit& unit, const In& in) {
  Shortfall& s = active_.shortfall;
  const Box3d box = judge_.ModelBox(cut_.index().unit(u.id).bounds);
  const bool inside = s.any() && s.bounds.Contains(box.min) && s.bounds.Contains(box.max);
  const auto count = [&](uint32_t slot, uint8_t code) {
    const double bound = judge_.Bound(code);
    const bool removable = unit.removers()[slot] != kDrain;
    const bool met = bound <= in.least || (in.most < 0 && !removable);
    const bool falls_short = bound > in.most && (removable || in.least >= 0) &&
                             bound - std::max(in.least, 0.0) <= s.excess;
    if (!met && !falls_short) {
      Count(unit, slot, unit.creator(slot), code, in);
      return;
    }
    ++active_.count;
    active_.largest_code = std::max(active_.largest_code, code);
    if (met) return;
    ++s.triangles;
    if (inside) return;
    for (const Vec3d& p : judge_.Corners(unit, slot, unit.creator(slot))) s.bounds.Add(p);
  };
  for (uint32_t slot = 0; u.looked && slot < u.first_own; ++slot) {
    if (!cut_.Present(u, unit, slot)) continue;
    count(slot, unit.cluster.error_codes[unit.cluster.removers[slot]]);
  }
  u.present.ForEach([&](uint32_t own) {
    const uint32_t slot = own + u.first_own;
    if (const int code = CodeOf(unit, slot); code >= 0) count(slot, static_cast<uint8_t>(code));
  });
}

void Survey::SurveyUnit(CutUnit& u, const LoadedUnit& unit, const In& in) {
  if (marks_ && u.active.empty()) u.active = Bits(unit.own_slots());
  for (uint32_t slot = 0; u.looked && slot < u.first_own; ++slot) {
    if (!cut_.Present(u, unit, slot)) continue;
    const uint8_t code = unit.cluster.error_codes[unit.cluster.removers[slot]];
    In in_slot = in;
    if (in.activity == Activity::kSome) in_slot.activity = KnownOfInTriangle(unit, slot);
    if (in_slot.activity == Activity::kNone) continue;
    if (!Count(unit, slot, kNone32, code, in_slot) || !marks_) continue;
    const SlotOrigin& origin = unit.origins[slot];
    CutUnit& parent = *cut_.Find(unit.parents[origin.parent]);
    if (parent.active.empty()) parent.active = Bits(parent.present.size());
    parent.active.Set(origin.slot - parent.first_own);
  }
  const bool all = in.activity == Activity::kAll && !falls_short_;
  if (!all && unit.nodes() > 0) {
    SurveyStars(u, unit, in);
    return;
  }
  // What nobody removes needs no look.
  if (all) {
    active_.count +=
        marks_ ? u.active.AddBoth(u.present.words(), unit.drain) : u.present.CountBoth(unit.drain);
  }
  u.present.ForEachWithout(
      all ? std::span<const uint64_t>(unit.drain) : std::span<const uint64_t>(), [&](uint32_t own) {
        const uint32_t slot = own + u.first_own;
        const int code = CodeOf(unit, slot);
        if (code < 0) return;
        const NodeIndex creator = all ? kNone32 : unit.creator(slot);
        if (Count(unit, slot, creator, static_cast<uint8_t>(code), in) && marks_) u.active.Set(own);
      });
}

// Star by star, whose bounds decide most cases. Of those that are all active, drains (of the full
// resolution) are counted only.
void Survey::SurveyStars(CutUnit& u, const LoadedUnit& unit, const In& in_unit) {
  const CompactCluster& cluster = unit.cluster;
  const bool asks = in_unit.activity == Activity::kSome;
  u.applied.ForEach([&](NodeIndex node) {
    In in = in_unit;
    if (asks) in.activity = KnownOfStar(u, unit, node);
    if (in.activity == Activity::kNone) return;
    const uint32_t begin = cluster.star_begin[node] - u.first_own;
    const uint32_t size = cluster.star_begin[node + 1] - u.first_own - begin;
    if (size == 0) return;
    const uint64_t present = BitsAt(u.present.words(), begin, size);
    if (present == 0) return;
    const uint64_t drains = present & BitsAt(unit.drain, begin, size);
    star_.clear();
    uint8_t largest = 0;
    for (uint64_t rest = present & ~drains; rest != 0; rest &= rest - 1) {
      const uint32_t own = begin + static_cast<uint32_t>(std::countr_zero(rest));
      const int code = CodeOf(unit, own + u.first_own);
      if (code < 0) continue;
      star_.emplace_back(own, static_cast<uint8_t>(code));
      largest = std::max(largest, star_.back().second);
    }
    if (star_.empty() && drains == 0) return;
    LookAround(unit, node, largest, &in);
    if (in.activity == Activity::kNone) return;
    const bool counts = in.activity == Activity::kAll && !in.drains_fall_short;
    if (counts && !marks_) active_.count += PopCount(drains);
    for (uint64_t rest = counts && !marks_ ? 0 : drains; rest != 0; rest &= rest - 1) {
      star_.emplace_back(begin + static_cast<uint32_t>(std::countr_zero(rest)), 0);
    }
    for (const auto& [own, code] : star_) {
      if (Count(unit, own + u.first_own, node, code, in) && marks_) u.active.Set(own);
    }
  });
}

// What is known of all triangles of a star with codes up to `largest`.
void Survey::LookAround(const LoadedUnit& unit, NodeIndex node, uint8_t largest, In* in) const {
  const double bound = judge_.Bound(largest);
  const bool shorts = falls_short_ && !(in->least > bound);
  in->drains_fall_short = shorts;
  const bool asks = shorts && judge_.asked() != nullptr;
  if (in->activity == Activity::kAll && !asks) return;
  const Box3d box = judge_.ModelBox(unit.star_bounds(node));
  if (in->activity == Activity::kSome) in->activity = judge_.ActivityIn(box, bound);
  if (!asks) return;
  const ErrorRange asked = judge_.asked()->Range(box, bound);
  in->least = asked.low;
  // Where only the full resolution will do, they are what was asked for.
  in->drains_fall_short = !(asked.low > bound) && asked.high >= 0;
}

// Of those that have not been looked at.
uint8_t Survey::LargestOfChildren(UnitId unit) const {
  uint8_t largest = 0;
  for (const UnitId child : cut_.index().children(unit)) {
    if (!cut_.Looked(child)) largest = std::max(largest, cut_.LargestCode(child));
  }
  return largest;
}

}  // namespace mtdb::internal
