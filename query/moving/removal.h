// SPDX-License-Identifier: Apache-2.0
// NodeRemoval: takes away what a cut no longer needs. docs/design.md, "Taking away".
#pragma once

#include <cstdint>
#include <vector>

#include "query/moving/moving_units.h"
#include "store/base/open_table.h"

namespace mtdb::internal {

// Weak nodes that a change may concern are suspended, and with a node all weak parents, and all
// weak nodes that refuse a triangle that it creates. Nodes that are not suspended have kept all
// their reasons. A suspended node that one of these needs is founded, and so is what is needed, or
// refused for what it creates, by the founded; the rest is unfounded and removed. What stays is
// part of the new least cut and holds the parents of all its nodes. Also see Strength.
class NodeRemoval {
 public:
  explicit NodeRemoval(MovingUnits& units) : units_(units) {}

  // `changed`: nodes that have become weak, and weak ones that refuse otherwise. Strength is right.
  Status Run(const std::vector<NodeKey>& changed);

 private:
  struct Suspended {
    NodeKey key;
    int32_t needed = 0;       // its triangles that nodes remove which are not suspended
    uint32_t lead = kNone32;  // in leads_: the first of its own
  };
  struct Lead {
    uint32_t to;  // in suspended_: founded when the one that it leads from is
    uint32_t next;
  };
  void Suspend(MovingUnit& u, NodeIndex node);
  // Of a suspended node: its place in suspended_.
  uint32_t PlaceOf(NodeKey key) const;
  void AddToTable(uint32_t place);
  void AddLead(uint32_t from, uint32_t to);
  Status SuspendAll();
  void SuspendAround(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  // Leaves unfounded nodes suspended, and no others.
  Status FindFounded();
  Status RemoveSuspended();
  void Remove(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);

  MovingUnits& units_;
  std::vector<Suspended> suspended_;
  OpenTable<uint32_t> table_;  // places by keys
  std::vector<Lead> leads_;
  std::vector<NodeIndex> nodes_;
};

}  // namespace mtdb::internal
