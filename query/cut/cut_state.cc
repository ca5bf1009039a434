// SPDX-License-Identifier: Apache-2.0
#include "query/cut/cut_state.h"

#include <algorithm>

#include "query/cut/unit_pins.h"
#include "query/fields/make_room.h"

namespace mtdb::internal {

bool CutState::AnyPresent(const CutUnit& u, const LoadedUnit& unit, NodeIndex node) const {
  const std::span<const LocalNumber> hole = unit.cluster.hole(node);
  return std::any_of(hole.begin(), hole.end(),
                     [&](uint32_t slot) { return Present(u, unit, slot); });
}

CutState::NodeRef CutState::CreatorOf(CutUnit& u, const LoadedUnit& unit, uint32_t slot) {
  if (slot >= u.first_own) return {&u, unit.creator(slot)};
  const SlotOrigin& origin = unit.origins[slot];
  return {origin.creator() == kNone32 ? nullptr : &Open(unit.parents[origin.parent]),
          origin.creator()};
}

void CutState::InsertRoot(CutUnit& u, const LoadedUnit& unit) {
  u.present.SetRange(0, unit.own_slots());
  counts_.triangles += unit.own_slots();
  if (!remembers()) return;
  for (uint32_t slot = 0; slot < unit.removers().size(); ++slot) {
    const uint32_t remover = unit.removers()[slot];
    ++counts_.by_code[remover == kDrain ? 0 : LargestCode(unit.children()[ChildOrdinal(remover)])];
  }
}

Status CutState::Insert(NodeRef target, UnitPins& pins, std::vector<NodeRef>* inserted) {
  const size_t first = inserted->size();
  const auto insert = [&]() -> Status {
    stack_.assign(1, target);
    while (!stack_.empty()) {
      const NodeRef top = stack_.back();
      CutUnit& u = *top.unit;
      if (u.applied.Test(top.node)) {
        stack_.pop_back();
        continue;
      }
      MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, pins.Pin(u));
      const size_t depth = stack_.size();
      for (const uint32_t slot : unit->cluster.hole(top.node)) {
        if (Present(u, *unit, slot)) continue;
        const NodeRef creator = CreatorOf(u, *unit, slot);
        if (creator.unit == nullptr || creator.unit->applied.Test(creator.node)) {
          return Inconsistent(u.id, "two nodes remove one triangle");
        }
        stack_.push_back(creator);
      }
      if (stack_.size() > depth) continue;
      MakeRoomForOne(*inserted);
      Exchange(u, *unit, top.node, true);
      inserted->push_back(top);
      stack_.pop_back();
    }
    return Status::Ok();
  };
  const Status status = insert();
  if (!status.ok()) {
    TakeBack(std::span(*inserted).subspan(first));
    inserted->resize(first);
  }
  return status;
}

void CutState::TakeBack(std::span<const NodeRef> inserted) {
  for (size_t i = inserted.size(); i-- > 0;) {
    Remove(*inserted[i].unit, *inserted[i].unit->pin, inserted[i].node);
  }
}

void CutState::Exchange(CutUnit& u, const LoadedUnit& unit, NodeIndex node, bool apply) {
  Save(u);
  const CompactCluster& cluster = unit.cluster;
  const std::span<const LocalNumber> hole = cluster.hole(node);
  const uint64_t n = apply ? 1 : ~uint64_t{0};  // modulo 2^64 this also takes away
  uint32_t entering = 0;                        // of the hole's triangles
  for (const uint32_t slot : hole) {
    CutUnit* of = &u;
    uint32_t own = slot - u.first_own;
    if (slot < u.first_own) {
      const SlotOrigin& origin = unit.origins[slot];
      of = Find(unit.parents[origin.parent]);
      own = origin.slot - of->first_own;
      Save(*of);
      ++entering;
    }
    of->present.Put(own, !apply);
  }
  const uint32_t begin = cluster.star_begin[node] - u.first_own;
  const uint32_t end = cluster.star_begin[node + 1] - u.first_own;
  if (apply) {
    u.present.SetRange(begin, end);
  } else {
    u.present.ClearRange(begin, end);
  }
  const IndexRange numbers = cluster.numbers_of(node);
  for (const NodeIndex number : numbers) u.applied.Put(number, apply);
  if (cluster.crumb(node)) [[unlikely]]
    NoteCrumb(u, cluster, node);
  u.applied_count += static_cast<uint32_t>(n) * numbers.size();
  counts_.applied += n * numbers.size();
  counts_.vertices += n * cluster.created_vertices(node).size();
  counts_.triangles += n * (end - begin - hole.size());
  if (!remembers()) return;
  const uint8_t* const codes = cluster.error_codes.data();
  counts_.by_code[codes[node]] -= n * (hole.size() - entering);
  counts_.by_code[u.looked ? codes[node] : LargestCode(u.id)] -= n * entering;  // as SetLooked does
  for (uint32_t slot = begin + u.first_own; slot < end + u.first_own; ++slot) {
    const uint32_t remover = cluster.removers[slot];
    if (RemovedByChild(remover)) {
      const UnitId child = cluster.children[ChildOrdinal(remover)];
      if (!Looked(child)) counts_.by_code[LargestCode(child)] += n;
      continue;
    }
    // Without a branch, which would be hard to predict.
    const bool drain = remover == kDrain;
    const uint8_t code = codes[drain ? node : remover];
    counts_.by_code[drain ? 0 : code] += n;
  }
}

void CutState::NoteCrumb(CutUnit& u, const CompactCluster& cluster, NodeIndex node) {
  // Its further numbers are never forced.
  if (!u.refusing.empty()) {
    const IndexRange numbers = cluster.numbers_of(node);
    for (NodeIndex i = node + 1; i < numbers.last; ++i) u.refusing.Set(i);
  }
  if (!cluster.without_vertex(node)) return;
  if (u.without_vertex.empty()) u.without_vertex = Bits(cluster.nodes());
  u.without_vertex.Set(node);
}

Result<uint32_t> CutState::InSlotOf(const LoadedUnit& unit, const Arc& arc) const {
  const uint32_t slot = unit.FindInSlot(arc);
  if (slot == kNone32) return NotArriving(unit.id);
  return slot;
}

void CutState::CountRound() {
  PrepareEnd();
  for (const UnitId id : touched()) {
    CutUnit& u = *Find(id);
    const uint32_t forced = u.applied_count == 0 ? 0 : u.applied.CountWithout(u.refusing.words());
    counts_.forced += forced;
    counts_.forced -= u.forced;
    u.forced = forced;
    counts_.clusters_used += u.applied_count > 0 ? 1 : 0;
    counts_.clusters_used -= u.before != nullptr && u.before->applied_count > 0 ? 1 : 0;
  }
}

uint8_t LargestCodeLeft(const CutState& cut) {
  const ClusterIndex& index = cut.index();
  uint8_t largest = 0;
  const auto add = [&](uint8_t code) { largest = std::max(largest, code); };
  for (const UnitId id : cut.open()) {
    if (cut.Find(id)->applied_count < index.unit(id).nodes) add(index.unit(id).error_code_max);
    for (const UnitId child : index.children(id)) {
      if (cut.Find(child) != nullptr) continue;
      // Of a unit that is missing itself, the rows of children need not be there.
      add(index.Has(child) ? index.unit(child).error_code_max : index.error_code_below(id));
    }
  }
  return largest;
}

}  // namespace mtdb::internal
