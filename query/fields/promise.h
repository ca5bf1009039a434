// SPDX-License-Identifier: Apache-2.0
// What a query promises of triangles whose vertices were rounded; docs/design.md, section 3.
#pragma once

#include <array>

#include "query/query.h"
#include "store/base/grid.h"
#include "store/base/shortfall.h"

namespace mtdb::internal {

// The bound b(t) of a triangle by its error's code: the error plus what rounding displaced.
inline double BoundOf(const Grid& grid, uint8_t code, double rounding) {
  return grid.Error(code) + rounding;
}
std::array<double, 256> BoundsByCode(const Grid& grid, double rounding);

// What can be given where `asked` is asked for; compared with bounds. Below `rounding` that is
// `rounding`: triangles without an error of their own are the best there are. Where `asked` is
// negative, and so only the full resolution will do, it is below every bound. Null: FullResolution.
ThresholdPtr Attainable(const ThresholdPtr& asked, double rounding);

// False only when nothing inside the box with the bound `rounding` or less can fall short.
bool MayFallShort(const ThresholdPtr& asked, const Box3d& box, double rounding);

// Counts t, an active triangle of this bound that a node removes or not, if it falls short.
void AddShortfall(const Threshold& asked, const Triangle3d& t, double bound, bool removable,
                  Shortfall* shortfall);

}  // namespace mtdb::internal
