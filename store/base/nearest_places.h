// SPDX-License-Identifier: Apache-2.0
// Where on segments the points lie that are nearest to each other.
#pragma once

#include <array>

#include "store/base/geometry.h"

namespace mtdb {

// Of ab, from 0 at a to 1 at b: the point that is nearest to p.
double NearestOnSegment(Vec3d p, Vec3d a, Vec3d b);
// Likewise of ab and of cd: two points that are nearest to each other.
std::array<double, 2> NearestOnSegments(Vec3d a, Vec3d b, Vec3d c, Vec3d d);

}  // namespace mtdb
