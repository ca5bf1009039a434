// SPDX-License-Identifier: Apache-2.0
#include "query/cut/cut_state.h"

#include <algorithm>
#include <string>

#include "query/cut/unit_pins.h"
#include "query/fields/make_room.h"

namespace mtdb::internal {

CutState::CutState(const ClusterSource& source, bool remembers)
    : source_(source),
      index_(source.index()),
      remembers_(remembers),
      units_(source.index().unit_count()) {}

CutUnit& CutState::Open(UnitId id) {
  return units_[id] != nullptr ? *units_[id] : Add(id, std::make_unique<CutUnit>());
}

CutUnit& CutState::Add(UnitId id, std::unique_ptr<CutUnit> unit) {
  CutUnit& u = *unit;
  u.id = id;
  u.place = static_cast<uint32_t>(open_.size());
  u.applied = u.wanted = Bits(index_.unit(id).nodes);
  if (remembers_) u.known = u.refusing = u.strong = u.applied;
  MakeRoomForOne(open_);
  MakeRoomForOne(touched_);
  units_[id] = std::move(unit);
  open_.push_back(id);
  touched_.push_back(id);
  return u;
}

void CutState::Size(CutUnit& u, const LoadedUnit& unit) const {
  Bits present(unit.own_slots());
  if (remembers_) u.refused = Bits(static_cast<uint32_t>(unit.cluster.hole_slots.size()));
  u.first_own = unit.first_own_slot();
  u.present = std::move(present);
}

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
  if (!remembers_) return;
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
  u.applied.Put(node, apply);
  u.applied_count += static_cast<uint32_t>(n);
  counts_.applied += n;
  counts_.vertices += n * cluster.created_vertices(node).size();
  counts_.triangles += n * (end - begin - hole.size());
  if (!remembers_) return;
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

Result<uint32_t> CutState::InSlotOf(const LoadedUnit& unit, const Arc& arc) const {
  const uint32_t slot = unit.FindInSlot(arc);
  if (slot == kNone32) return NotArriving(unit.id);
  return slot;
}

Status CutState::NotArriving(UnitId unit) const {
  return Inconsistent(unit, "an arc to it does not arrive");
}

void CutState::Keep(CutUnit& u) {
  MakeRoomForOne(touched_);
  if (spare_.empty()) {
    u.before = std::make_unique<CutFlags>(u);
  } else {
    *spare_.back() = u;
    u.before = std::move(spare_.back());
    spare_.pop_back();
  }
  touched_.push_back(u.id);
}

void CutState::CountRound() {
  spare_.reserve(touched_.size());
  for (const UnitId id : touched_) {
    CutUnit& u = *units_[id];
    const uint32_t forced = u.applied_count == 0 ? 0 : u.applied.CountWithout(u.refusing.words());
    counts_.forced += forced;
    counts_.forced -= u.forced;
    u.forced = forced;
    counts_.clusters_used += u.applied_count > 0 ? 1 : 0;
    counts_.clusters_used -= u.before != nullptr && u.before->applied_count > 0 ? 1 : 0;
  }
}

void CutState::EndRound() {
  spare_.clear();
  for (const UnitId id : touched_) {
    CutUnit& u = *units_[id];
    if (u.before != nullptr) spare_.push_back(std::move(u.before));
    u.fresh = false;
  }
  touched_.clear();
  counts_before_ = counts_;
}

void CutState::Undo() {
  for (const UnitId id : touched_) {
    CutUnit& u = *units_[id];
    if (u.fresh) {
      units_[id].reset();
    } else {
      static_cast<CutFlags&>(u) = std::move(*u.before);
      u.before.reset();
    }
  }
  touched_.clear();
  counts_ = counts_before_;
  DropClosed();
  for (const UnitId id : open_) {
    CutUnit& u = *units_[id];
    u.queued = false;
    u.arrivals.clear();
    u.wanted.ClearAll();
  }
}

Status CutState::Inconsistent(UnitId unit, const char* what) const {
  return Corrupt(UnitName(source_.record(), unit) + ": " + what + "; rebuild the object");
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
