// SPDX-License-Identifier: Apache-2.0
#include "query/internal/survey.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

#include "query/internal/deadlines.h"

namespace mtdb::internal {

Result<ActiveTriangles> Survey::Run(bool complete, const Box3d& bounds) {
  active_.all = judge_.whole();
  falls_short_ = !complete || MayFallShort(judge_.asked(), bounds, judge_.rounding());
  if (falls_short_ && judge_.by_code() && complete) {
    // All triangles have the same bound.
    active_.shortfall = {cut_.counts().triangles, judge_.rounding() - *judge_.asked()->constant(),
                         bounds};
    falls_short_ = false;
  }
  const bool codes_only = active_.all && !falls_short_;
  if (codes_only) active_.count = cut_.counts().triangles;
  if (codes_only && cut_.remembers()) {
    active_.largest_code = cut_.counts().LargestCode();
    return active_;
  }
  if (moving_ && !falls_short_) return RunMoving();
  for (const UnitId id : cut_.open()) {
    CutUnit& u = *cut_.Find(id);
    if (u.present.empty()) continue;
    if (codes_only) {
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
    const bool by_codes =
        !moving_ || static_cast<MovingUnit&>(u).deadlines.margin > 0 || in.most < judge_.rounding();
    const bool counts =
        in.activity == Activity::kAll && falls_short_ && by_codes && (!marks_ || active_.all);
    MTDB_RETURN_IF_ERROR(pins_.RunOn(u, [&](const LoadedUnit& unit) {
      counts ? CountShort(u, unit, in) : SurveyUnit(u, unit, in);
      return Status::Ok();
    }));
  }
  return active_;
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
    if (moving_ && in.activity == Activity::kSome) in_slot.activity = ActivityOf(unit, slot);
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
  const bool asks = moving_ && in_unit.activity == Activity::kSome;
  u.applied.ForEach([&](NodeIndex node) {
    In in = in_unit;
    if (asks) in.activity = Deadlines::SideOf(judge_, static_cast<MovingUnit&>(u), unit, node);
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

// Of an in-triangle: as its creator's star.
Activity Survey::ActivityOf(const LoadedUnit& unit, uint32_t slot) const {
  const SlotOrigin& origin = unit.origins[slot];
  const auto& parent = static_cast<const MovingUnit&>(*cut_.Find(unit.parents[origin.parent]));
  return ActivityOf(parent, origin.creator());
}

Activity Survey::ActivityOf(const MovingUnit& u, NodeIndex creator) const {
  const UnitDeadlines& d = u.deadlines;
  if (d.activity != Activity::kSome) return d.activity;
  return creator == kNone32 || d.sides.empty() ? Activity::kSome
                                               : Deadlines::SideToActivity(d.sides[creator]);
}

// Where the region's border is not near, which the decisions have told, triangles are counted by
// their bits, and a code is looked at if it is larger than those before.
Result<ActiveTriangles> Survey::RunMoving() {
  for (const UnitId id : cut_.open()) {
    auto& u = static_cast<MovingUnit&>(*cut_.Find(id));
    if (u.present.empty()) continue;
    if (u.deadlines.activity == Activity::kAll) active_.count += u.present.Count();
    if (u.deadlines.activity != Activity::kSome) continue;
    MTDB_RETURN_IF_ERROR(pins_.RunOn(u, [&](const LoadedUnit& unit) {
      CountStars(u, unit);
      return Status::Ok();
    }));
  }
  // What children remove and is near the border.
  std::sort(near_.begin(), near_.end());
  for (size_t i = 0; i < near_.size();) {
    CutUnit& child = *cut_.Find(near_[i].first);
    MTDB_RETURN_IF_ERROR(pins_.RunOn(child, [&](const LoadedUnit& unit) -> Status {
      for (; i < near_.size() && near_[i].first == child.id; ++i) {
        MTDB_ASSIGN_OR_RETURN(const uint32_t slot, cut_.InSlotOf(unit, near_[i].second));
        const uint8_t code = unit.cluster.error_codes[unit.cluster.removers[slot]];
        if (code <= LargestBelow(255)) CountNear(unit, slot, kNone32, code, false);
      }
      return Status::Ok();
    }));
  }
  // By now it is known of all stars.
  for (const UnitId id : cut_.open()) {
    auto& u = static_cast<MovingUnit&>(*cut_.Find(id));
    if (u.present.empty() || u.deadlines.activity == Activity::kNone) continue;
    const bool by_nodes = LargestBelow(cut_.LargestCode(id)) > active_.largest_code;
    const bool by_children = LargestOfChildren(id) > active_.largest_code;
    if (!by_nodes && !by_children) continue;
    MTDB_RETURN_IF_ERROR(pins_.RunOn(u, [&](const LoadedUnit& unit) {
      if (by_nodes) FindLargestOfNodes(u, unit);
      if (by_children) FindLargestOfChildren(u, unit);
      return Status::Ok();
    }));
  }
  return active_;
}

// Of a triangle that a node removes: it would be refused if it had a larger code and were active.
int Survey::LargestBelow(uint8_t code) const {
  return judge_.constant() ? std::min<int>(code, judge_.valid_code()) : code;
}

// Of those that have not been looked at.
uint8_t Survey::LargestOfChildren(UnitId unit) const {
  uint8_t largest = 0;
  for (const UnitId child : cut_.index().children(unit)) {
    if (!cut_.Looked(child)) largest = std::max(largest, cut_.LargestCode(child));
  }
  return largest;
}

void Survey::CountStars(MovingUnit& u, const LoadedUnit& unit) {
  const auto count = [&](uint32_t own, NodeIndex creator) {
    const uint32_t slot = own + u.first_own;
    const uint32_t remover = unit.removers()[slot];
    const int code = CodeOf(unit, slot);
    if (code < 0) {
      near_.emplace_back(unit.children()[ChildOrdinal(remover)], Arc{u.id, slot});
      return;
    }
    // It is in its remover's hole, too.
    const bool has_node = RemovedByNode(remover);
    const Activity activity = has_node ? ActivityOf(u, remover) : Activity::kSome;
    if (activity == Activity::kNone || (has_node && code > LargestBelow(255))) return;
    CountNear(unit, slot, creator, static_cast<uint8_t>(code), activity == Activity::kAll);
  };
  if (unit.nodes() == 0) u.present.ForEach([&](uint32_t own) { count(own, kNone32); });
  const CompactCluster& cluster = unit.cluster;
  const auto star_begin = [&](NodeIndex node) { return cluster.star_begin[node] - u.first_own; };
  const auto count_star = [&](NodeIndex node) {
    const uint32_t begin = star_begin(node);
    const uint32_t size = star_begin(node + 1) - begin;
    if (size == 0) return;
    const uint64_t present = BitsAt(u.present.words(), begin, size);
    if (present == 0) return;
    const Activity activity = Deadlines::SideOf(judge_, u, unit, node);
    if (activity == Activity::kAll) active_.count += PopCount(present);
    if (activity != Activity::kSome) return;
    for (uint64_t rest = present; rest != 0; rest &= rest - 1) {
      count(begin + static_cast<uint32_t>(std::countr_zero(rest)), node);
    }
  };
  for (NodeIndex first = 0; first < unit.nodes(); first += 64) {
    const uint64_t applied = u.applied.words()[first / 64];
    uint64_t inside = 0;
    uint64_t near = applied;
    if (const std::vector<float>& sides = u.deadlines.sides; applied != 0 && !sides.empty()) {
      inside = applied & BitsWhere(sides.data() + first, [](float side) { return side > 0; });
      near &= ~inside & ~BitsWhere(sides.data() + first, [](float side) { return side < 0; });
    }
    // Stars follow each other; those of nodes that are not applied have no present triangles.
    const uint32_t nodes = std::min(unit.nodes() - first, uint32_t{64});
    for (uint32_t i = 0; inside != 0 && i < nodes;) {
      const uint64_t rest = (inside | ~applied) >> i;
      const uint32_t run = std::min(static_cast<uint32_t>(std::countr_one(rest)), nodes - i);
      if (run > 0) {
        active_.count += u.present.CountRange(star_begin(first + i), star_begin(first + i + run));
      }
      i += run + 1;
    }
    for (; near != 0; near &= near - 1) {
      count_star(first + static_cast<uint32_t>(std::countr_zero(near)));
    }
  }
}

void Survey::CountNear(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code,
                       bool active) {
  if (!active && !judge_.Active(judge_.Corners(unit, slot, creator), judge_.Bound(code))) return;
  ++active_.count;
  active_.largest_code = std::max(active_.largest_code, code);
}

// In the mesh, and known to be active.
bool Survey::IsActive(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot) const {
  if (!cut_.Present(u, unit, slot)) return false;
  if (slot < u.first_own) return ActivityOf(unit, slot) == Activity::kAll;
  const bool all = u.deadlines.activity == Activity::kAll;
  return all || ActivityOf(u, unit.creator(slot)) == Activity::kAll;
}

void Survey::FindLargestOfNodes(const MovingUnit& u, const LoadedUnit& unit) {
  const int most = LargestBelow(255);
  u.known.ForEachWithout(u.applied.words(), [&](NodeIndex node) {
    const uint8_t code = unit.cluster.error_codes[node];
    if (code <= active_.largest_code || code > most) return;
    const std::span<const LocalNumber> hole = unit.cluster.hole(node);
    if (std::any_of(hole.begin(), hole.end(), [&](auto slot) { return IsActive(u, unit, slot); })) {
      active_.largest_code = code;
    }
  });
}

void Survey::FindLargestOfChildren(const MovingUnit& u, const LoadedUnit& unit) {
  u.present.ForEach([&](uint32_t own) {
    const uint32_t slot = own + u.first_own;
    if (!RemovedByChild(unit.removers()[slot])) return;
    const int code = CodeOf(unit, slot);
    if (code <= active_.largest_code || !IsActive(u, unit, slot)) return;
    active_.largest_code = static_cast<uint8_t>(code);
  });
}

}  // namespace mtdb::internal
