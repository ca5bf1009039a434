// SPDX-License-Identifier: Apache-2.0
#include "query/internal/removal.h"

#include <algorithm>

#include "query/internal/fetch_nodes.h"

namespace mtdb::internal {

Status Removal::Run(const std::vector<NodeKey>& changed) {
  suspended_.clear();
  needed_.clear();
  leads_.clear();
  for (const NodeKey key : changed) Suspend(*units_.Find(UnitOf(key)), NodeOf(key));
  MTDB_RETURN_IF_ERROR(SuspendAll());
  MTDB_RETURN_IF_ERROR(FindFounded());
  return RemoveSuspended();
}

void Removal::Suspend(MovingUnit& u, NodeIndex node) {
  if (!u.applied.Test(node) || u.strong.Test(node)) return;
  if (u.suspended.empty()) u.suspended = Bits(u.applied.size());
  if (u.suspended.Test(node)) return;
  u.suspended.Set(node);
  suspended_.push_back(KeyOf(u.id, node));
  u.new_suspended.push_back(node);
  units_.queue().Add(u);
}

Status Removal::SuspendAll() {
  return units_.RunQueue([&](MovingUnit& u, const LoadedUnit& unit) -> Status {
    MTDB_RETURN_IF_ERROR(units_.ForEachArrival(u, unit, [&](NodeIndex node) {
      if (u.refusing.Test(node)) Suspend(u, node);
    }));
    while (!u.new_suspended.empty()) {
      nodes_.clear();
      nodes_.swap(u.new_suspended);
      ForEachFetched(unit, nodes_, Fetch::kStars,
                     [&](NodeIndex node) { SuspendAround(u, unit, node); });
    }
    return Status::Ok();
  });
}

void Removal::SuspendAround(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  const CompactCluster& cluster = unit.cluster;
  const NodeKey key = KeyOf(u.id, node);
  const uint32_t hole_begin = cluster.hole_begin[node];
  const std::span<const LocalNumber> hole = cluster.hole(node);
  for (uint32_t i = 0; i < hole.size(); ++i) {
    const CutState::NodeRef creator = units_.CreatorOf(u, unit, hole[i]);
    if (creator.unit == nullptr || creator.unit->strong.Test(creator.node)) continue;
    const NodeKey parent = KeyOf(creator.unit->id, creator.node);
    Suspend(static_cast<MovingUnit&>(*creator.unit), creator.node);
    --needed_[parent];
    leads_.emplace_back(key, parent);
    if (u.refused.Test(hole_begin + i)) leads_.emplace_back(parent, key);
  }
  const uint32_t begin = cluster.star_begin[node] - u.first_own;
  const uint32_t end = cluster.star_begin[node + 1] - u.first_own;
  const uint32_t removed = end - begin - u.present.CountRange(begin, end);
  if (removed == 0) return;
  needed_[key] += static_cast<int32_t>(removed);
  for (uint32_t own = begin; own < end; ++own) {
    if (u.present.Test(own)) continue;
    const uint32_t slot = own + u.first_own;
    const uint32_t remover = cluster.removers[slot];
    if (!RemovedByNode(remover)) {
      units_.queue().Add(*units_.Find(cluster.children[ChildOrdinal(remover)]), {u.id, slot});
    } else if (u.refusing.Test(remover)) {
      Suspend(u, remover);
    }
  }
}

Status Removal::FindFounded() {
  std::sort(leads_.begin(), leads_.end());
  std::vector<NodeKey> founded;
  const auto found = [&](NodeKey key) {
    Bits& suspended = units_.Find(UnitOf(key))->suspended;
    if (!suspended.Test(NodeOf(key))) return;
    suspended.Clear(NodeOf(key));
    founded.push_back(key);
  };
  for (const auto& [key, slots] : needed_) {
    if (slots > 0) found(key);
  }
  while (!founded.empty()) {
    if (!units_.judge().meter().Spend(1)) return units_.judge().meter().status();
    const NodeKey key = founded.back();
    founded.pop_back();
    for (auto lead = std::lower_bound(leads_.begin(), leads_.end(), std::pair(key, NodeKey{0}));
         lead != leads_.end() && lead->first == key; ++lead) {
      found(lead->second);
    }
  }
  return Status::Ok();
}

Status Removal::RemoveSuspended() {
  // Children before parents: ascending units, descending nodes.
  std::erase_if(suspended_, [&](NodeKey key) {
    return !units_.Find(UnitOf(key))->suspended.Test(NodeOf(key));
  });
  std::sort(suspended_.begin(), suspended_.end(), [](NodeKey a, NodeKey b) {
    return UnitOf(a) != UnitOf(b) ? UnitOf(a) < UnitOf(b) : NodeOf(a) > NodeOf(b);
  });
  for (size_t i = 0; i < suspended_.size();) {
    MovingUnit& u = *units_.Find(UnitOf(suspended_[i]));
    nodes_.clear();
    for (; i < suspended_.size() && UnitOf(suspended_[i]) == u.id; ++i) {
      nodes_.push_back(NodeOf(suspended_[i]));
    }
    u.suspended.ClearAll();
    MTDB_RETURN_IF_ERROR(units_.pins().RunOn(u, [&](const LoadedUnit& unit) {
      ForEachFetched(unit, nodes_, Fetch::kStars, [&](NodeIndex node) { Remove(u, unit, node); });
      return Status::Ok();
    }));
  }
  // Units that have been looked at know the errors of what has gone.
  return units_.RunQueue([&](MovingUnit& u, const LoadedUnit& unit) {
    return units_.ForEachArrival(u, unit,
                                 [&](NodeIndex node) { units_.CountArrival(unit, node, -1); });
  });
}

void Removal::Remove(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  units_.Remove(u, unit, node);
  const CompactCluster& cluster = unit.cluster;
  for (uint32_t slot = cluster.star_begin[node]; slot < cluster.star_begin[node + 1]; ++slot) {
    const uint32_t remover = cluster.removers[slot];
    if (!RemovedByChild(remover)) continue;
    MovingUnit* const child = units_.Find(cluster.children[ChildOrdinal(remover)]);
    if (child != nullptr) units_.queue().Add(*child, {u.id, slot});
  }
}

}  // namespace mtdb::internal
