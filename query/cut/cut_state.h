// SPDX-License-Identifier: Apache-2.0
// CutState: a cut of the Multi-Triangulation: which nodes are applied, which triangles are present.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "query/cache/loaded_unit.h"
#include "query/cut/cut_units.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

class UnitPins;

// Every change goes through Insert and Remove, so that the applied nodes hold all their parents and
// the present triangles are the cut's mesh. One thread.
class CutState : public CutUnits {
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

  // With `remembers` Counts::by_code is kept, too.
  CutState(const ClusterSource& source, bool remembers) : CutUnits(source, remembers) {}

  const Counts& counts() const { return counts_; }

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
  // What the cut keeps of an applied node that brings a crumb.
  static void NoteCrumb(CutUnit& u, const CompactCluster& cluster, NodeIndex node);
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

  // Before the round ends: counts what Counts says of the end of a round.
  void CountRound();
  void EndRound() {
    CutUnits::EndRound();
    counts_before_ = counts_;
  }
  // The cut is that of the last round's end. Needs no memory.
  void Undo() {
    CutUnits::Undo();
    counts_ = counts_before_;
  }
  // Between rounds.
  void DropClosed() {
    CutUnits::DropClosed();
    counts_before_ = counts_;  // a unit that is closed tells less of its errors
  }

 private:
  // Puts the node's star in the place of its hole, or (not `apply`) back.
  void Exchange(CutUnit& u, const LoadedUnit& unit, NodeIndex node, bool apply);

  Counts counts_;
  Counts counts_before_;
  std::vector<NodeRef> stack_;
};

// What has been left to do: the largest error code of nodes that are not applied, of open units,
// and of those of their children.
uint8_t LargestCodeLeft(const CutState& cut);

}  // namespace mtdb::internal
