// SPDX-License-Identifier: Apache-2.0
// Deadlines: what a new query can change in a cut. docs/design.md, "What a new query can change".
#pragma once

#include <vector>

#include "query/moving/moving_units.h"

namespace mtdb::internal {

// For each known node: which of its triangles are refused, and how far the threshold has to fall or
// rise, or borders of regions to shift, before that can be otherwise; for each child that is not
// open: before it can be needed. Thresholds and regions bound their change over a unit's box, and
// the sums of these bounds are compared with the deadlines, so that only what may have changed is
// looked at.
class Deadlines {
 public:
  // What a query changed, with what was before.
  struct Moved {
    const Judge::Fields* from;
    const Region* from_region;
    bool threshold;
    bool region;
  };

  explicit Deadlines(MovingUnits& units) : units_(units), judge_(units.judge()) {}

  // What has to be decided again. Overwritten by the next unit.
  const Expired& Advance(MovingUnit& u, const Moved& moved);
  // After Advance, with the unit at hand: leaves those nodes whose decisions a box around them does
  // not confirm.
  const Expired& LookAround(MovingUnit& u, const LoadedUnit& unit, const Moved& moved);

 private:
  // By how much the query changed in the unit; false when that is not known.
  bool AddChange(MovingUnit& u, const Moved& moved, bool was_clear) const;
  // Of the threshold by which the unit's nodes are judged, or its children are wanted.
  FieldChange ChangeIn(const MovingUnit& u, const Box3d& box, const Judge::Fields& from) const;
  // In model units; what the node removes and creates is inside.
  Box3d BoxAround(const MovingUnit& u, const LoadedUnit& unit, NodeIndex node) const;
  // The border was not at the node and is not: its decision stands.
  bool StaysAside(MovingUnit& u, const Box3d& around, NodeIndex node) const;
  // Borders moved in the unit, but around the node by less than its deadline allows.
  bool StaysNear(MovingUnit& u, const Box3d& around, NodeIndex node, const Moved& moved) const;
  // What is known of all triangles in the box decides as was decided.
  bool Stands(MovingUnit& u, const Box3d& around, NodeIndex node, uint8_t code) const;

  const MovingUnits& units_;
  const Judge& judge_;
  Expired expired_;
};

}  // namespace mtdb::internal
