// SPDX-License-Identifier: Apache-2.0
// Decisions: which triangles of a moving cut are refused, and until when that stands.
#pragma once

#include <vector>

#include "query/moving/moving_units.h"

namespace mtdb::internal {

// Asks the query about nodes, triangles and children, and keeps the answers with their deadlines.
// Changes CutFlags::known, refusing and refused.
class Decisions {
 public:
  explicit Decisions(MovingUnits& units) : units_(units), judge_(units.judge()) {}

  // Looks which triangles of the node's hole are refused, present or not. True when that is new.
  bool Evaluate(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  // Makes a node known; true when it has to be evaluated: its code does not tell that it is valid.
  bool Learn(MovingUnit& u, NodeIndex node, uint8_t code);
  // A node that is not applied, and of whose hole nothing is present.
  void Forget(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  // Of the triangles of the node's hole and star, in a unit through which the border passes, as far
  // as a box around them tells.
  static Activity SideOf(const Judge& judge, UnitDeadlines& d, const LoadedUnit& unit,
                         NodeIndex node);

  // Before a slot of the unit is refused, with an error of this code; a negative fall when it is.
  Leeway Margin(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot, uint8_t code) const;
  // Before any triangle is refused that the child, which is not open, could remove; a negative fall
  // when that does not tell.
  Leeway ChildMargin(const MovingUnit& u, UnitId child) const;

  // Nodes that were evaluated, or learnt, since the last call of ResetCount.
  uint64_t evaluated() const { return evaluated_; }
  void ResetCount() { evaluated_ = 0; }

 private:
  struct Verdict {
    bool some = false, all = false;  // triangles are refused
    Leeway leeway;
  };
  Verdict Look(UnitDeadlines& d, const LoadedUnit& unit, NodeIndex node);
  Verdict LookAtTriangles(const LoadedUnit& unit, NodeIndex node, bool all_active, double shift);
  // Until the border can have come to the triangle, or left it.
  double ActiveLeeway(const Triangle3d& t, double bound, bool active, double most) const;

  MovingUnits& units_;
  const Judge& judge_;
  std::vector<bool> refused_;  // of LookAtTriangles
  uint64_t evaluated_ = 0;
};

}  // namespace mtdb::internal
