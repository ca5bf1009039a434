// SPDX-License-Identifier: Apache-2.0
// Removal: takes away what a cut no longer needs. docs/design.md, "Taking away".
#pragma once

#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "query/internal/moving_units.h"

namespace mtdb::internal {

// Weak nodes that a change may concern are suspended, and with a node all weak parents, and all
// weak nodes that refuse a triangle that it creates. Nodes that are not suspended have kept all
// their reasons. A suspended node that one of these needs is founded, and so is what is needed, or
// refused for what it creates, by the founded; the rest is unfounded and removed. What stays is
// part of the new least cut and holds the parents of all its nodes. Also see Strength.
class Removal {
 public:
  explicit Removal(MovingUnits& units) : units_(units) {}

  // `changed`: nodes that have become weak, and weak ones that refuse otherwise. Strength is right.
  Status Run(const std::vector<NodeKey>& changed);

 private:
  void Suspend(MovingUnit& u, NodeIndex node);
  Status SuspendAll();
  void SuspendAround(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  // Leaves unfounded nodes suspended, and no others.
  Status FindFounded();
  Status RemoveSuspended();
  void Remove(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);

  MovingUnits& units_;
  std::vector<NodeKey> suspended_;
  // Per suspended node: its triangles that nodes remove which are not suspended. Not listed: none.
  std::unordered_map<NodeKey, int32_t> needed_;
  std::vector<std::pair<NodeKey, NodeKey>> leads_;  // the first, if founded, makes the second so
  std::vector<NodeIndex> nodes_;
};

}  // namespace mtdb::internal
