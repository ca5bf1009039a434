// SPDX-License-Identifier: Apache-2.0
#include "query/moving/strength.h"

#include "query/cut/fetch_nodes.h"

namespace mtdb::internal {

void Strength::Recheck(MovingUnit& u, NodeIndex node) {
  if (u.recheck.empty()) u.recheck = Bits(u.applied.size());
  u.recheck.Set(node);
  units_.queue().Add(u);
}

Status Strength::Run(std::vector<NodeKey>* weakened) {
  return units_.RunQueue([&](MovingUnit& u, const LoadedUnit& unit) -> Status {
    if (u.recheck.empty()) u.recheck = Bits(u.applied.size());
    MTDB_RETURN_IF_ERROR(
        units_.ForEachArrival(u, unit, [&](NodeIndex node) { u.recheck.Set(node); }));
    nodes_.clear();
    u.recheck.ForEach([&](NodeIndex node) { nodes_.push_back(node); });
    ForEachFetched(unit, nodes_, Fetch::kStars, [](NodeIndex) {});
    // More come on the way, all of them later ones.
    for (NodeIndex n = u.recheck.FirstFrom(0); n != kNone32; n = u.recheck.FirstFrom(n + 1)) {
      if (!u.applied.Test(n)) continue;
      const bool strong = IsStrong(u, unit, n);
      if (strong == u.strong.Test(n)) continue;
      units_.Save(u);
      u.strong.Put(n, strong);
      if (!strong) weakened->push_back(KeyOf(u.id, n));
      RecheckRemovers(u, unit, n);
    }
    u.recheck = Bits();
    return Status::Ok();
  });
}

void Strength::RecheckRemovers(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  const CompactCluster& cluster = unit.cluster;
  for (uint32_t slot = cluster.star_begin[node]; slot < cluster.star_begin[node + 1]; ++slot) {
    if (u.present.Test(slot - u.first_own)) continue;
    const uint32_t remover = cluster.removers[slot];
    if (RemovedByNode(remover)) {
      u.recheck.Set(remover);
    } else {
      units_.queue().Add(*units_.Find(cluster.children[ChildOrdinal(remover)]), {u.id, slot});
    }
  }
}

void Strength::Find(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  units_.Save(u);
  u.strong.Put(node, IsStrong(u, unit, node));
}

bool Strength::IsStrong(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) const {
  if (!u.refusing.Test(node)) return false;
  const uint32_t begin = unit.cluster.hole_begin[node];
  const std::span<const LocalNumber> hole = unit.cluster.hole(node);
  for (uint32_t i = 0; i < hole.size(); ++i) {
    if (!u.refused.Test(begin + i)) continue;
    const CutState::NodeRef creator = units_.CreatorOf(u, unit, hole[i]);
    if (creator.unit == nullptr || creator.unit->strong.Test(creator.node)) return true;
  }
  return false;
}

}  // namespace mtdb::internal
