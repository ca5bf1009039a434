// SPDX-License-Identifier: Apache-2.0
#include "query/moving/moving_survey.h"

#include <algorithm>
#include <bit>
#include <span>

#include "query/moving/decisions.h"

namespace mtdb::internal {

Result<ActiveTriangles> MovingSurvey::Run(bool complete, const Box3d& bounds) {
  if (Begin(complete, bounds)) return active_;
  if (!falls_short_) return RunMoving();
  MTDB_RETURN_IF_ERROR(SurveyUnits(complete));
  return active_;
}

Activity MovingSurvey::KnownOfStar(CutUnit& u, const LoadedUnit& unit, NodeIndex node) const {
  return Decisions::SideOf(judge_, static_cast<MovingUnit&>(u).deadlines, unit, node);
}

bool MovingSurvey::StarsTellMore(const CutUnit& u) const {
  return !(static_cast<const MovingUnit&>(u).deadlines.bounds.margin > 0);
}

// Of an in-triangle: as its creator's star.
Activity MovingSurvey::KnownOfInTriangle(const LoadedUnit& unit, uint32_t slot) const {
  const SlotOrigin& origin = unit.origins[slot];
  const auto& parent = static_cast<const MovingUnit&>(*cut_.Find(unit.parents[origin.parent]));
  return ActivityOf(parent, origin.creator());
}

Activity MovingSurvey::ActivityOf(const MovingUnit& u, NodeIndex creator) const {
  const UnitDeadlines& d = u.deadlines;
  if (d.bounds.activity != Activity::kSome) return d.bounds.activity;
  return creator == kNone32 ? Activity::kSome : d.side(creator).activity();
}

// Where the region's border is not near, which the decisions have told, triangles are counted by
// their bits, and a code is looked at if it is larger than those before.
Result<ActiveTriangles> MovingSurvey::RunMoving() {
  for (const UnitId id : cut_.open()) {
    auto& u = static_cast<MovingUnit&>(*cut_.Find(id));
    if (u.present.empty()) continue;
    if (u.deadlines.bounds.activity == Activity::kAll) active_.count += u.present.Count();
    if (u.deadlines.bounds.activity != Activity::kSome) continue;
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
    if (u.present.empty() || u.deadlines.bounds.activity == Activity::kNone) continue;
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
int MovingSurvey::LargestBelow(uint8_t code) const {
  return judge_.constant() ? std::min<int>(code, judge_.valid_code()) : code;
}

void MovingSurvey::CountStars(MovingUnit& u, const LoadedUnit& unit) {
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
    const Activity activity = Decisions::SideOf(judge_, u.deadlines, unit, node);
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
    if (const std::span<const Side> sides = u.deadlines.sides(); applied != 0 && !sides.empty()) {
      inside = applied & BitsWhere(sides.data() + first,
                                   [](Side s) { return s.activity() == Activity::kAll; });
      near &= ~inside & ~BitsWhere(sides.data() + first,
                                   [](Side s) { return s.activity() == Activity::kNone; });
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

void MovingSurvey::CountNear(const LoadedUnit& unit, uint32_t slot, NodeIndex creator, uint8_t code,
                             bool active) {
  if (!active && !judge_.Active(judge_.Corners(unit, slot, creator), judge_.Bound(code))) return;
  ++active_.count;
  active_.largest_code = std::max(active_.largest_code, code);
}

// In the mesh, and known to be active.
bool MovingSurvey::IsActive(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot) const {
  if (!cut_.Present(u, unit, slot)) return false;
  if (slot < u.first_own) return KnownOfInTriangle(unit, slot) == Activity::kAll;
  const bool all = u.deadlines.bounds.activity == Activity::kAll;
  return all || ActivityOf(u, unit.creator(slot)) == Activity::kAll;
}

void MovingSurvey::FindLargestOfNodes(const MovingUnit& u, const LoadedUnit& unit) {
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

void MovingSurvey::FindLargestOfChildren(const MovingUnit& u, const LoadedUnit& unit) {
  u.present.ForEach([&](uint32_t own) {
    const uint32_t slot = own + u.first_own;
    if (!RemovedByChild(unit.removers()[slot])) return;
    const int code = CodeOf(unit, slot);
    if (code <= active_.largest_code || !IsActive(u, unit, slot)) return;
    active_.largest_code = static_cast<uint8_t>(code);
  });
}

}  // namespace mtdb::internal
