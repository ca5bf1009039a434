// SPDX-License-Identifier: Apache-2.0
#include "query/moving/removal.h"

#include <algorithm>

#include "query/cut/fetch_nodes.h"

namespace mtdb::internal {
namespace {

constexpr size_t kLeastTable = 1024;

}  // namespace

Status NodeRemoval::Run(const std::vector<NodeKey>& changed) {
  suspended_.clear();
  leads_.clear();
  table_.Reset(kLeastTable);
  for (const NodeKey key : changed) Suspend(*units_.Find(UnitOf(key)), NodeOf(key));
  MTDB_RETURN_IF_ERROR(SuspendAll());
  MTDB_RETURN_IF_ERROR(FindFounded());
  return RemoveSuspended();
}

void NodeRemoval::Suspend(MovingUnit& u, NodeIndex node) {
  if (!u.applied.Test(node) || u.strong.Test(node)) return;
  if (u.suspended.empty()) u.suspended = Bits(u.applied.size());
  if (u.suspended.Test(node)) return;
  u.suspended.Set(node);
  suspended_.push_back({KeyOf(u.id, node)});
  AddToTable(static_cast<uint32_t>(suspended_.size() - 1));
  u.new_suspended.push_back(node);
  units_.queue().Add(u);
}

uint32_t NodeRemoval::PlaceOf(NodeKey key) const {
  return table_.Find(HashOfNumber(key), [&](uint32_t p) { return suspended_[p].key == key; });
}

// At most half of it is used.
void NodeRemoval::AddToTable(uint32_t place) {
  const auto hash_of = [&](uint32_t p) { return HashOfNumber(suspended_[p].key); };
  if (2 * suspended_.size() > table_.size()) table_.Resize(2 * table_.size(), hash_of);
  table_.FindEmpty(hash_of(place)) = place;
}

void NodeRemoval::AddLead(uint32_t from, uint32_t to) {
  leads_.push_back({to, suspended_[from].lead});
  suspended_[from].lead = static_cast<uint32_t>(leads_.size() - 1);
}

Status NodeRemoval::SuspendAll() {
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

void NodeRemoval::SuspendAround(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  const CompactCluster& cluster = unit.cluster;
  const uint32_t place = PlaceOf(KeyOf(u.id, node));
  const uint32_t hole_begin = cluster.hole_begin[node];
  const std::span<const LocalNumber> hole = cluster.hole(node);
  for (uint32_t i = 0; i < hole.size(); ++i) {
    const CutState::NodeRef creator = units_.CreatorOf(u, unit, hole[i]);
    if (creator.unit == nullptr || creator.unit->strong.Test(creator.node)) continue;
    Suspend(static_cast<MovingUnit&>(*creator.unit), creator.node);
    const uint32_t parent = PlaceOf(KeyOf(creator.unit->id, creator.node));
    --suspended_[parent].needed;
    AddLead(place, parent);
    if (u.refused.Test(hole_begin + i)) AddLead(parent, place);
  }
  const uint32_t begin = cluster.star_begin[node] - u.first_own;
  const uint32_t end = cluster.star_begin[node + 1] - u.first_own;
  const uint32_t removed = end - begin - u.present.CountRange(begin, end);
  if (removed == 0) return;
  suspended_[place].needed += static_cast<int32_t>(removed);
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

Status NodeRemoval::FindFounded() {
  std::vector<uint32_t> founded;
  const auto found = [&](uint32_t place) {
    const NodeKey key = suspended_[place].key;
    Bits& suspended = units_.Find(UnitOf(key))->suspended;
    if (!suspended.Test(NodeOf(key))) return;
    suspended.Clear(NodeOf(key));
    founded.push_back(place);
  };
  for (uint32_t place = 0; place < suspended_.size(); ++place) {
    if (suspended_[place].needed > 0) found(place);
  }
  while (!founded.empty()) {
    if (!units_.judge().meter().Spend(1)) return units_.judge().meter().status();
    const uint32_t place = founded.back();
    founded.pop_back();
    for (uint32_t l = suspended_[place].lead; l != kNone32; l = leads_[l].next) {
      found(leads_[l].to);
    }
  }
  return Status::Ok();
}

Status NodeRemoval::RemoveSuspended() {
  // Children before parents: ascending units, descending nodes.
  std::vector<UnitId> units;
  for (const Suspended& s : suspended_) {
    if (units.empty() || units.back() != UnitOf(s.key)) units.push_back(UnitOf(s.key));
  }
  std::sort(units.begin(), units.end());
  units.erase(std::unique(units.begin(), units.end()), units.end());
  for (const UnitId id : units) {
    MovingUnit& u = *units_.Find(id);
    nodes_.clear();
    u.suspended.ForEach([&](NodeIndex node) { nodes_.push_back(node); });
    if (nodes_.empty()) continue;
    std::reverse(nodes_.begin(), nodes_.end());
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

void NodeRemoval::Remove(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
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
