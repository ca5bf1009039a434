// SPDX-License-Identifier: Apache-2.0
// VerticalReach: regions and thresholds of a terrain, whose errors are heights.
#pragma once

#include <array>

#include "query/region.h"
#include "query/threshold.h"

namespace mtdb::internal {

// `region` and `threshold` as a terrain asks them: what lies within `distance` of a triangle is
// what lies up to `distance` above or below it, since places may be degrees where heights are
// metres. Errs to the safe side: where the plain answer for that distance in space and the one for
// the box around the swept triangle both say yes, so does this one.
// With `aside` what lies up to aside[0] * distance beside it along x, and aside[1] * distance along
// y, counts too: of terrains whose border moves.
RegionPtr VerticalReach(RegionPtr region, std::array<double, 2> aside = {0, 0});
// Min is the larger of two lower bounds: over what is within `distance` in space, and over the box
// around the swept triangle.
ThresholdPtr VerticalReach(ThresholdPtr threshold, std::array<double, 2> aside = {0, 0});

}  // namespace mtdb::internal
