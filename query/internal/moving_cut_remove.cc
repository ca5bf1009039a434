// MovingCut: the nodes that a new query no longer needs.
//
// A node is in the least cut for one of two reasons: it removes a refused triangle that the root or
// a node of the cut creates, or it creates a triangle that a node of the cut removes. Errors may
// grow along arcs, so reasons may run in circles, which are no reason: a node refuses a triangle
// that is there for its own sake only. So taking away what has no reason would not do. A node is
// strong when it refuses a triangle that the root or a strong node creates; along such chains there
// are no circles, since arcs have none, and most nodes are strong. The others are weak: reasons of
// these can run in circles among weak nodes.
//
// Strengthen finds again who is strong, parents first. Then all weak nodes are suspended whose
// reasons may lead to a node that has become weak, or weak ones that refuse otherwise: with a node,
// all weak parents, and all weak nodes that refuse a triangle that it creates. Nodes that are not
// suspended have kept all their reasons. A suspended node that one of these needs is founded, and
// so is what is needed, or refused for what it creates, by the founded; the rest is unfounded and
// goes away. What stays is part of the new least cut and holds the parents of all its nodes, so
// that refinement from there leads to it.
#include <algorithm>

#include "query/internal/moving_cut.h"

namespace mtdb {

bool MovingCut::IsStrong(const Unit& u, const LoadedUnit& unit, NodeIndex node) const {
  if (!u.refusing.Test(node)) return false;
  const uint32_t begin = unit.cluster.hole_begin[node];
  const std::span<const uint32_t> hole = unit.cluster.hole(node);
  for (uint32_t i = 0; i < hole.size(); ++i) {
    if (!u.refused.Test(begin + i)) continue;
    const uint32_t slot = hole[i];
    if (slot >= u.first_own) {
      if (u.strong.Test(unit.creator(slot))) return true;
      continue;
    }
    const SlotOrigin& origin = unit.origins[slot];
    if (origin.creator == kNone32) return true;
    const Unit* const parent = Find(unit.parents[origin.parent]);
    if (parent != nullptr && parent->strong.Test(origin.creator)) return true;
  }
  return false;
}

Status MovingCut::Strengthen() {
  while (!queue_.empty()) {
    Unit& u = TakeQueued();
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
    for (const Arc& arc : u.arrivals) {
      MTDB_ASSIGN_OR_RETURN(const NodeIndex node, RemoverOf(*unit, arc));
      u.dirty.Set(node);
    }
    u.arrivals.clear();
    u.dirty.ForEach([&](NodeIndex node) { todo_.push_back(node); });
    ForEachFetched(*unit, todo_, Fetch::kStars, [](NodeIndex) {});
    todo_.clear();
    for (NodeIndex n = u.dirty.FirstFrom(0); n != kNone32; n = u.dirty.FirstFrom(n + 1)) {
      u.dirty.Clear(n);
      if (!u.applied.Test(n)) continue;
      const bool strong = IsStrong(u, *unit, n);
      if (strong == u.strong.Test(n)) continue;
      Save(u);
      if (strong) {
        u.strong.Set(n);
      } else {
        u.strong.Clear(n);
        seeds_.push_back(KeyOf(u.id, n));
      }
      const Cluster& cluster = unit->cluster;
      for (uint32_t slot = cluster.star_begin[n]; slot < cluster.star_begin[n + 1]; ++slot) {
        if (u.present.Test(slot - u.first_own)) continue;
        const uint32_t remover = cluster.removers[slot];
        if (RemovedByNode(remover)) {
          u.dirty.Set(remover);
          continue;
        }
        Unit& child = *Find(cluster.children[ChildOrdinal(remover)]);
        child.arrivals.push_back({u.id, slot});
        Enqueue(child);
      }
    }
  }
  return Status::Ok();
}

void MovingCut::Suspend(Unit& u, NodeIndex node) {
  if (!u.applied.Test(node) || u.strong.Test(node)) return;
  if (u.dirty.Test(node)) return;
  u.dirty.Set(node);
  suspended_.push_back(KeyOf(u.id, node));
  u.todo.push_back(node);
  Enqueue(u);
}

Status MovingCut::SuspendAll() {
  suspended_.clear();
  holds_.clear();
  leads_.clear();
  for (const Key key : seeds_) {
    Suspend(*Find(static_cast<UnitId>(key >> 32)), static_cast<NodeIndex>(key));
  }
  while (!queue_.empty()) {
    Unit& u = TakeQueued();
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
    for (const Arc& arc : u.arrivals) {
      MTDB_ASSIGN_OR_RETURN(const NodeIndex node, RemoverOf(*unit, arc));
      if (u.refusing.Test(node)) Suspend(u, node);
    }
    u.arrivals.clear();
    while (!u.todo.empty()) {
      todo_.swap(u.todo);
      ForEachFetched(*unit, todo_, Fetch::kStars,
                     [&](NodeIndex node) { SuspendAround(u, *unit, node); });
      todo_.clear();
    }
  }
  return Status::Ok();
}

void MovingCut::SuspendAround(Unit& u, const LoadedUnit& unit, NodeIndex node) {
  const Cluster& cluster = unit.cluster;
  const Key key = KeyOf(u.id, node);
  const uint32_t hole_begin = cluster.hole_begin[node];
  const std::span<const uint32_t> hole = cluster.hole(node);
  for (uint32_t i = 0; i < hole.size(); ++i) {
    Unit* of = &u;
    NodeIndex creator = 0;
    if (hole[i] >= u.first_own) {
      creator = unit.creator(hole[i]);
    } else {
      const SlotOrigin& origin = unit.origins[hole[i]];
      if (origin.creator == kNone32) continue;
      of = Find(unit.parents[origin.parent]);
      creator = origin.creator;
    }
    if (of->strong.Test(creator)) continue;
    Suspend(*of, creator);
    --holds_[KeyOf(of->id, creator)];
    leads_.emplace_back(key, KeyOf(of->id, creator));
    if (u.refused.Test(hole_begin + i)) leads_.emplace_back(KeyOf(of->id, creator), key);
  }
  const uint32_t begin = cluster.star_begin[node] - u.first_own;
  const uint32_t end = cluster.star_begin[node + 1] - u.first_own;
  const uint32_t removed = end - begin - u.present.CountRange(begin, end);
  if (removed == 0) return;
  holds_[key] += static_cast<int32_t>(removed);
  for (uint32_t own = begin; own < end; ++own) {
    if (u.present.Test(own)) continue;
    const uint32_t remover = cluster.removers[own + u.first_own];
    if (RemovedByNode(remover)) {
      if (u.refusing.Test(remover)) Suspend(u, remover);
      continue;
    }
    Unit& child = *Find(cluster.children[ChildOrdinal(remover)]);
    child.arrivals.push_back({u.id, own + u.first_own});
    Enqueue(child);
  }
}

Status MovingCut::RemoveUnfounded() {
  std::sort(leads_.begin(), leads_.end());
  std::vector<Key> founded;
  const auto found = [&](Key key) {
    Unit& u = *Find(static_cast<UnitId>(key >> 32));
    const auto node = static_cast<NodeIndex>(key);
    if (!u.dirty.Test(node)) return;
    u.dirty.Clear(node);
    founded.push_back(key);
  };
  for (const auto& [key, slots] : holds_) {
    if (slots > 0) found(key);
  }
  while (!founded.empty()) {
    if (!meter_->Spend(1)) return meter_->status();
    const Key key = founded.back();
    founded.pop_back();
    for (auto lead = std::lower_bound(leads_.begin(), leads_.end(), std::pair(key, Key{0}));
         lead != leads_.end() && lead->first == key; ++lead) {
      found(lead->second);
    }
  }
  // Children before parents: ascending units, descending nodes.
  std::vector<Key> unfounded;
  for (const Key key : suspended_) {
    Unit& u = *Find(static_cast<UnitId>(key >> 32));
    const auto node = static_cast<NodeIndex>(key);
    if (!u.dirty.Test(node)) continue;
    u.dirty.Clear(node);
    unfounded.push_back(key ^ 0xffffffffu);
  }
  std::sort(unfounded.begin(), unfounded.end());
  for (size_t i = 0; i < unfounded.size();) {
    Unit& u = *Find(static_cast<UnitId>(unfounded[i] >> 32));
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
    todo_.clear();
    for (; i < unfounded.size() && unfounded[i] >> 32 == u.id; ++i) {
      todo_.push_back(~static_cast<NodeIndex>(unfounded[i]));
    }
    ForEachFetched(*unit, todo_, Fetch::kStars, [&](NodeIndex node) { Remove(u, *unit, node); });
  }
  todo_.clear();
  // Open children know the errors of what has gone.
  while (!queue_.empty()) {
    Unit& u = TakeQueued();
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
    for (const Arc& arc : u.arrivals) {
      MTDB_ASSIGN_OR_RETURN(const NodeIndex node, RemoverOf(*unit, arc));
      --totals_.by_code[unit->cluster.error_codes[node]];
    }
    u.arrivals.clear();
  }
  return Status::Ok();
}

void MovingCut::Remove(Unit& u, const LoadedUnit& unit, NodeIndex node) {
  Save(u);
  const Cluster& cluster = unit.cluster;
  const uint32_t begin = cluster.star_begin[node] - u.first_own;
  const uint32_t end = cluster.star_begin[node + 1] - u.first_own;
  u.present.ClearRange(begin, end);
  const std::span<const uint32_t> hole = cluster.hole(node);
  for (const uint32_t slot : hole) SetPresent(u, unit, slot, true);
  u.applied.Clear(node);
  --u.applied_count;
  --totals_.applied;
  totals_.triangles -= end - begin;
  totals_.triangles += hole.size();
  totals_.by_code[cluster.error_codes[node]] += hole.size();
  for (uint32_t slot = begin + u.first_own; slot < end + u.first_own; ++slot) {
    const uint32_t remover = cluster.removers[slot];
    if (RemovedByNode(remover)) {
      --totals_.by_code[cluster.error_codes[remover]];
    } else if (remover == kDrain) {
      --totals_.by_code[0];
    } else if (const UnitId id = cluster.children[ChildOrdinal(remover)];
               Unit* const child = Find(id)) {
      child->arrivals.push_back({u.id, slot});
      Enqueue(*child);
    } else {
      --totals_.by_code[LargestCode(id)];
    }
  }
}

}  // namespace mtdb
