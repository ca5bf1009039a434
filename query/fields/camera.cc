// SPDX-License-Identifier: Apache-2.0
#include "query/camera.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

namespace mtdb {
namespace {

constexpr double kSmallestAngle = 1e-6;  // radians
constexpr int kLargestViewport = 1 << 20;

bool Finite(Vec3d v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

// No overflow, whatever the length.
Vec3d Unit(Vec3d v) {
  v = v * (1 / std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}));
  return v * (1 / Length(v));
}

bool HasDirection(Vec3d v) {
  const double largest = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
  return Finite(v) && largest >= std::numeric_limits<double>::min();
}

}  // namespace

Status Camera::Validate() const {
  if (!Finite(eye)) return InvalidArgument("the camera's eye must be finite");
  if (!HasDirection(direction)) {
    return InvalidArgument("the camera must look somewhere: its direction has no length");
  }
  if (!HasDirection(up)) return InvalidArgument("the camera's up has no length");
  if (Length(Cross(Unit(direction), Unit(up))) < kSmallestAngle) {
    return InvalidArgument("the camera's up must not lie along its direction; give another up");
  }
  if (!(vertical_fov_rad >= kSmallestAngle &&
        vertical_fov_rad <= std::numbers::pi - kSmallestAngle)) {
    return InvalidArgument(
        "the camera's field of view must be from 1e-6 to pi - 1e-6 radians, above 0 and below "
        "180 degrees");
  }
  if (width_px < 1 || height_px < 1 || width_px > kLargestViewport ||
      height_px > kLargestViewport) {
    return InvalidArgument("the camera's viewport must have from 1 to " +
                           std::to_string(kLargestViewport) + " pixels a side");
  }
  if (!(near >= 0 && std::isfinite(near) && far > near)) {
    return InvalidArgument("the camera's near must not be negative, and its far beyond near");
  }
  return Status::Ok();
}

Camera::Axes Camera::axes() const {
  Axes a;
  a.forward = Unit(direction);
  a.right = Unit(Cross(a.forward, Unit(up)));
  a.up = Cross(a.right, a.forward);
  return a;
}

double Camera::tangent_y() const { return std::tan(vertical_fov_rad / 2); }

double Camera::tangent_x() const { return tangent_y() * width_px / height_px; }

}  // namespace mtdb
