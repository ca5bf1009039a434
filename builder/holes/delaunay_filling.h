// SPDX-License-Identifier: Apache-2.0
// DelaunayFilling: the Delaunay triangulation of the ring, of height fields.
#pragma once

#include "builder/holes/filling_rule.h"
#include "builder/holes/hole.h"
#include "store/base/in_circle.h"

namespace mtdb::internal {

// Fills a hole by the Delaunay triangulation of its ring, seen along z and constrained by the
// ring's edges, with ties broken by IsInCircle. So it does not depend on the order in which
// vertices went: what is left is the Delaunay triangulation of the vertices that are left, where
// the border did not change. Work units are integers along x and y.
class DelaunayFilling {
 public:
  static constexpr bool kReadsEdgeErrors = false;
  void Open(const Hole&) {}
  bool Fill(const Hole& hole, Hole::Triangles& triangles) const;
};
static_assert(FillingRule<DelaunayFilling>);

}  // namespace mtdb::internal
