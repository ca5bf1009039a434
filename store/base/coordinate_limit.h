// SPDX-License-Identifier: Apache-2.0
// How large the numbers of meshes and queries are at most.
#pragma once

#include "store/base/geometry.h"

namespace mtdb {

// The eighth power of this, which distances need, is finite.
constexpr double kMaxCoordinate = 1e30;

// False for NaN.
constexpr bool IsCoordinate(double value) {
  return value >= -kMaxCoordinate && value <= kMaxCoordinate;
}
constexpr bool AreCoordinates(Vec3d p) {
  return IsCoordinate(p.x) && IsCoordinate(p.y) && IsCoordinate(p.z);
}

// Of texture coordinates, u and v.
inline constexpr float kMostTextureCoordinate = 16777216;

}  // namespace mtdb
