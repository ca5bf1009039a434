// SPDX-License-Identifier: Apache-2.0
// Deadlines: what a new query can change in a cut. docs/design.md, "What a new query can change".
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "query/moving/moving_units.h"

namespace mtdb::internal {

// For each known node: which of its triangles are refused, and how far the threshold has to fall or
// rise, or borders of regions to shift, before that can be otherwise; for each child that is not
// open: before it can be needed. Thresholds and regions bound their change over a unit's box, and
// the sums of these bounds are compared with the deadlines, so that only what may have changed is
// looked at. Changes CutFlags::known, refusing and refused.
class Deadlines {
 public:
  // What a query changed, with what was before.
  struct Moved {
    const Judge::Fields* from;
    const Region* from_region;
    bool threshold;
    bool region;
  };
  // What has to be decided again, in one unit. Overwritten by the next.
  struct Expired {
    bool all = false;
    std::vector<NodeIndex> nodes;
    std::vector<NodeIndex> sides;    // the region's border may have come to these
    std::vector<uint32_t> children;  // ordinals; their deadlines have passed
  };

  explicit Deadlines(MovingUnits& units) : units_(units), judge_(units.judge()) {}

  // Of a unit that is opened: nothing is known.
  static void Begin(const Judge& judge, const ClusterIndex& index, MovingUnit& u);
  const Expired& Advance(MovingUnit& u, const Moved& moved);

  // After Advance, with the unit at hand: leaves those nodes whose decisions a box around them does
  // not confirm.
  const Expired& LookAround(MovingUnit& u, const LoadedUnit& unit, const Moved& moved);
  // Of the triangles of the node's hole and star, in a unit through which the border passes, as far
  // as a box around them tells.
  static Activity SideOf(const Judge& judge, MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  // Of UnitDeadlines::sides; kSome when that has not been asked.
  static Activity SideToActivity(float side) {
    return side > 0 ? Activity::kAll : side < 0 ? Activity::kNone : Activity::kSome;
  }
  // Looks which triangles of the node's hole are refused, present or not. True when that is new.
  bool Evaluate(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  // Makes a node known; true when it has to be evaluated: its code does not tell that it is valid.
  bool Learn(MovingUnit& u, NodeIndex node, uint8_t code);
  // Known, but waits to be evaluated: its deadline has passed.
  static bool Waits(const MovingUnit& u, NodeIndex node) {
    return u.deadlines.nodes[node] == kPassed && !u.refusing.Test(node);
  }
  // A node that is not applied, and of whose hole nothing is present.
  void Forget(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);

  // Before a slot of the unit is refused, with an error of this code; a negative fall when it is.
  Leeway Margin(const MovingUnit& u, const LoadedUnit& unit, uint32_t slot, uint8_t code) const;
  // Likewise of all triangles that the child, which is not open, could remove; a negative fall when
  // that does not tell.
  Leeway ChildMargin(const MovingUnit& u, UnitId child) const;
  // The child is needed no sooner than this (a negative fall: not known); than both.
  static void SetChild(MovingUnit& u, uint32_t ordinal, const Leeway& leeway);
  static void AddChild(MovingUnit& u, uint32_t ordinal, const Leeway& leeway);
  // The child waits to be asked about: its deadline has passed.
  static void SetChildWaits(MovingUnit& u, uint32_t ordinal);
  static bool ChildWaits(const MovingUnit& u, uint32_t ordinal) {
    return u.deadlines.children[ordinal] == kPassed;
  }

  // Nodes that were evaluated, or learnt, since the last call of ResetCount.
  uint64_t evaluated() const { return evaluated_; }
  void ResetCount() { evaluated_ = 0; }

 private:
  static constexpr float kPassed =
      std::numeric_limits<float>::infinity();  // as a deadline of `low`
  static constexpr float kMixed = std::numeric_limits<float>::quiet_NaN();  // compares false

  struct Verdict {
    bool some = false, all = false;  // triangles are refused
    Leeway leeway;
  };
  Verdict Look(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  Verdict LookAtTriangles(const LoadedUnit& unit, NodeIndex node, bool all_active, double shift);
  // Until the border can have come to the triangle, or left it.
  double ActiveLeeway(const Triangle3d& t, double bound, bool active, double most) const;
  // By how much the query changed in the unit; false when that is not known.
  bool AddChange(MovingUnit& u, const Moved& moved, bool was_clear) const;
  // Of the threshold by which the unit's nodes are judged, or its children are wanted.
  FieldChange ChangeIn(const MovingUnit& u, const Box3d& box, const Judge::Fields& from) const;
  static void FindRanges(const Judge& judge, MovingUnit& u);
  void FindExpired(MovingUnit& u);
  void FindExpiredNodes(MovingUnit& u);
  void FindExpiredMixed(MovingUnit& u);
  static void SetNode(UnitDeadlines& d, NodeIndex node, bool refuses, float deadline);
  static void SetShift(UnitDeadlines& d, NodeIndex node, float shift);
  static void SetSide(UnitDeadlines& d, NodeIndex node, float side);
  static void FindSide(const Judge& judge, UnitDeadlines& d, const LoadedUnit& unit,
                       NodeIndex node);
  static void SetReach(UnitDeadlines& d, const LoadedUnit& unit, NodeIndex node, const Box3i& box);
  static void SetLeeway(UnitDeadlines& d, NodeIndex node, bool refuses, const Leeway& leeway);
  // In model units; what the node removes and creates is inside.
  Box3d BoxAround(const MovingUnit& u, const LoadedUnit& unit, NodeIndex node) const;
  // The border was not at the node and is not: its decision stands.
  bool StaysAside(MovingUnit& u, const Box3d& around, NodeIndex node) const;
  // Borders moved in the unit, but around the node by less than its deadline allows.
  bool StaysNear(MovingUnit& u, const Box3d& around, NodeIndex node, const Moved& moved) const;
  // What is known of all triangles in the box decides as was decided.
  bool Stands(MovingUnit& u, const Box3d& around, NodeIndex node, uint8_t code) const;

  MovingUnits& units_;
  const Judge& judge_;
  Expired expired_;
  std::vector<bool> refused_;  // of LookAtTriangles
  uint64_t evaluated_ = 0;
};

}  // namespace mtdb::internal
