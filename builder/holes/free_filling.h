// SPDX-License-Identifier: Apache-2.0
// FreeFilling: the filling with the least errors, of all triangulations of the ring.
#pragma once

#include <array>
#include <cstdint>

#include "builder/holes/filling_rule.h"
#include "builder/holes/hole.h"

namespace mtdb::internal {

// Finds the triangulation of the ring that has the least sum of costs: the squared error of each
// diagonal, and a small one for each triangle's shape, which decides where surfaces are flat.
// Triangles that face away are not allowed. Of a folded hole, where nothing is known of diagonals,
// shapes and the distances from the vertex that goes decide, and triangles that face away are a
// last resort.
class FreeFilling {
 public:
  static constexpr bool kReadsEdgeErrors = true;

  void Open(const Hole& hole);
  bool Fill(const Hole& hole, Hole::Triangles& triangles) const;

 private:
  void SetSeenCosts(const Hole& hole);
  void SetFoldedCosts(const Hole& hole);
  // By cost(i, m, j).
  template <typename Cost>
  void SetCosts(uint32_t k, const Cost& cost);

  // Of the triangles (i, m, j), by j - i, i and m.
  std::array<double, Hole::kMaxRing*(Hole::kMaxRing - 1) * (Hole::kMaxRing - 2) / 6> costs_;
};
static_assert(FillingRule<FreeFilling>);

}  // namespace mtdb::internal
