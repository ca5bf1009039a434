// SPDX-License-Identifier: Apache-2.0
// Strength: why a node is in a cut. docs/design.md, "Why a node is there".
#pragma once

#include <vector>

#include "query/moving/moving_units.h"

namespace mtdb::internal {

// A node is in the least cut for one of two reasons: it removes a refused triangle that the root or
// a node of the cut creates, or it creates a triangle that a node of the cut removes. Errors may
// grow along arcs, so reasons may run in circles, which are no reason: a node refuses a triangle
// that is there for its own sake only. A node is strong when it refuses a triangle that the root or
// a strong node creates; along such chains there are no circles, since arcs have none, and most
// nodes are strong. The other applied nodes are weak. Changes CutFlags::strong.
class Strength {
 public:
  explicit Strength(MovingUnits& units) : units_(units) {}

  // What an applied node refuses has changed.
  void Recheck(MovingUnit& u, NodeIndex node);
  // Finds again who is strong, parents first, from where that may have changed. Appends the nodes
  // that have become weak.
  Status Run(std::vector<NodeKey>* weakened);
  // A node that has been applied, after its parents.
  void Find(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);

 private:
  bool IsStrong(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) const;
  // Those that remove the node's triangles.
  void RecheckRemovers(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);

  MovingUnits& units_;
  std::vector<NodeIndex> nodes_;
};

}  // namespace mtdb::internal
