// SPDX-License-Identifier: Apache-2.0
// CutState: a cut of the Multi-Triangulation: which nodes are applied, which triangles are present.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "query/cache/loaded_unit.h"
#include "query/cut/bits.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

class UnitPins;

// What a cut knows of one unit. "Own slot" s is the unit's slot first_own + s: in-triangles are
// counted where they are created. The last four are empty in a cut that is not to move.
struct CutFlags {
  Bits applied;   // per node
  Bits present;   // per own slot: in the mesh; empty until the unit has been pinned
  Bits known;     // per node: what follows is known of it; all that are applied, and more
  Bits refusing;  // per node: removes a refused triangle
  Bits refused;   // per place in Cluster::hole_slots: that triangle is refused
  Bits strong;    // per node: applied, and refused triangles alone are why; see strength.h
  uint32_t applied_count = 0;
  uint32_t forced = 0;  // applied and not refusing; at the end of a round
};

struct CutUnit : CutFlags {
  virtual ~CutUnit() = default;

  UnitId id = 0;
  uint32_t place = 0;  // in CutState::open(), as long as no unit has been closed
  uint32_t first_own = 0;
  bool looked = false;  // all its in-triangles have been looked at
  bool fresh = true;    // opened in this round
  bool queued = false;  // in the UnitQueue
  bool prefetched = false;
  const LoadedUnit* pin = nullptr;   // while UnitPins holds it
  std::unique_ptr<CutFlags> before;  // at the end of the last round, where it differs
  Bits active;                       // per own slot: see Survey
  // Work: arcs whose triangles have come or gone, and nodes that may have to be applied.
  std::vector<Arc> arrivals;
  Bits wanted;
};

// The units that a cut reaches, open as long as something is kept of them. Every change goes
// through Insert and Remove, so that the applied nodes hold all their parents and the present
// triangles are the cut's mesh. Changes belong to a round, which is ended or undone as a whole. One
// thread.
class CutState {
 public:
  struct Counts {
    uint64_t triangles = 0;
    uint64_t applied = 0;        // nodes
    uint64_t vertices = 0;       // that they insert
    uint64_t forced = 0;         // nodes that remove no refused triangle; at the end of a round
    uint64_t clusters_used = 0;  // with an applied node; likewise
    // Triangles by the code of their error; for a child that has not been looked at its largest.
    // Only where remembers().
    std::array<uint64_t, 256> by_code{};
    uint8_t LargestCode() const {
      uint8_t code = 255;
      while (code > 0 && by_code[code] == 0) --code;
      return code;
    }
  };
  struct NodeRef {
    CutUnit* unit;
    NodeIndex node;
  };

  // With `remembers` CutFlags::known, refusing, refused and strong have room.
  CutState(const ClusterSource& source, bool remembers);
  virtual ~CutState() = default;
  CutState(const CutState&) = delete;
  CutState& operator=(const CutState&) = delete;

  const ClusterIndex& index() const { return index_; }
  const Counts& counts() const { return counts_; }
  bool remembers() const { return remembers_; }
  // Of a node of the unit.
  uint8_t LargestCode(UnitId unit) const { return index_.unit(unit).error_code_max; }
  std::span<const UnitId> open() const { return open_; }
  CutUnit* Find(UnitId unit) const { return units_[unit].get(); }
  // One that has been looked at: it knows the errors of its in-triangles.
  bool Looked(UnitId unit) const { return units_[unit] != nullptr && units_[unit]->looked; }
  // Finds the unit, or opens it: no node applied, no triangle present.
  virtual CutUnit& Open(UnitId unit);
  // For UnitPins: room for what only the loaded unit tells.
  void Size(CutUnit& u, const LoadedUnit& unit) const;

  bool Present(const CutUnit& u, const LoadedUnit& unit, uint32_t slot) const {
    if (slot >= u.first_own) return u.present.Test(slot - u.first_own);
    const SlotOrigin& origin = unit.origins[slot];
    const CutUnit* const parent = Find(unit.parents[origin.parent]);
    return parent != nullptr && !parent->present.empty() &&
           parent->present.Test(origin.slot - parent->first_own);
  }
  bool AnyPresent(const CutUnit& u, const LoadedUnit& unit, NodeIndex node) const;
  // The node that creates the slot; none for the root's triangles.
  NodeRef CreatorOf(CutUnit& u, const LoadedUnit& unit, uint32_t slot);

  // A piece of the root comes into the mesh.
  void InsertRoot(CutUnit& u, const LoadedUnit& unit);
  // Applies the node, before it those of its ancestors that are missing; appends all to `inserted`,
  // in this order. Opens and pins units. On an error nothing has changed. Errors: kCorrupt when two
  // nodes remove one triangle, and those of pinning.
  Status Insert(NodeRef target, UnitPins& pins, std::vector<NodeRef>* inserted);
  // What Insert did; the units are still pinned.
  void TakeBack(std::span<const NodeRef> inserted);
  // An applied node, none of whose children is applied.
  void Remove(CutUnit& u, const LoadedUnit& unit, NodeIndex node) {
    Exchange(u, unit, node, false);
  }
  // Counts nodes that were applied by other means: see StoredOrderPass.
  void CountInserted(uint64_t nodes, uint64_t vertices, uint64_t triangles) {
    counts_.applied += nodes;
    counts_.vertices += vertices;
    counts_.triangles += triangles;
  }

  // The in-slot of `unit` that an arc to it arrives at.
  Result<uint32_t> InSlotOf(const LoadedUnit& unit, const Arc& arc) const;
  // Errors by code: `n` present in-triangles of a node of a looked-at unit have come; all present
  // ones of a unit that is looked at from now on, or not any more.
  void CountArrival(const LoadedUnit& unit, NodeIndex node, int n) {
    counts_.by_code[unit.cluster.error_codes[node]] += static_cast<uint64_t>(n);
  }
  // Calls f(node) for the removers of these.
  template <typename F>
  void SetLooked(CutUnit& u, const LoadedUnit& unit, bool looked, F&& f) {
    u.looked = looked;
    const uint8_t largest = LargestCode(u.id);
    for (uint32_t slot = 0; slot < u.first_own; ++slot) {
      if (!Present(u, unit, slot)) continue;
      const NodeIndex node = unit.cluster.removers[slot];
      const uint64_t n = looked ? 1 : ~uint64_t{0};
      counts_.by_code[largest] -= n;
      counts_.by_code[unit.cluster.error_codes[node]] += n;
      f(node);
    }
  }

  // Before the flags of a unit change in a round.
  void Save(CutUnit& u) {
    if (!u.fresh && u.before == nullptr) Keep(u);
  }
  // Before the round ends: counts what Counts says of the end of a round.
  void CountRound();
  void EndRound();
  // The cut is that of the last round's end. Needs no memory.
  void Undo();
  // Saved or opened in this round.
  std::span<const UnitId> touched() const { return touched_; }
  // Forgets a unit without applied nodes; it stays in open() until DropClosed.
  void Close(CutUnit& u) { units_[u.id].reset(); }
  // Between rounds.
  void DropClosed() {
    std::erase_if(open_, [&](UnitId id) { return units_[id] == nullptr; });
    counts_before_ = counts_;  // a unit that is closed tells less of its errors
  }

  Status Inconsistent(UnitId unit, const char* what) const;
  Status NotArriving(UnitId unit) const;  // an arc to it

 protected:
  // In all lists or in none.
  CutUnit& Add(UnitId id, std::unique_ptr<CutUnit> unit);

 private:
  void Keep(CutUnit& u);
  // Puts the node's star in the place of its hole, or (not `apply`) back.
  void Exchange(CutUnit& u, const LoadedUnit& unit, NodeIndex node, bool apply);

  const ClusterSource& source_;
  const ClusterIndex& index_;
  const bool remembers_;
  std::vector<std::unique_ptr<CutUnit>> units_;
  std::vector<UnitId> open_;
  std::vector<UnitId> touched_;
  std::vector<std::unique_ptr<CutFlags>>
      spare_;  // for CutUnit::before; as many as the last round's
  Counts counts_;
  Counts counts_before_;
  std::vector<NodeRef> stack_;
};

// What has been left to do: the largest error code of nodes that are not applied, of open units,
// and of those of their children.
uint8_t LargestCodeLeft(const CutState& cut);

}  // namespace mtdb::internal
