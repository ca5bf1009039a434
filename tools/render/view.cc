// SPDX-License-Identifier: Apache-2.0
#include "tools/render/view.h"

#include <cmath>

namespace mtdb {

namespace {

constexpr double kBroader = 1.75;  // as tools/viewer/src/navigation.ts has them
constexpr double kFlat = 0.3;

Vec3d Unit(Vec3d v) {
  const double n = Length(v);
  return n > 0 ? v * (1 / n) : Vec3d{0, 0, 1};
}

// Where the viewer of the front looks.
Vec3d FrontDirection(Vec3d up) {
  const bool y_up = std::fabs(up.y) > std::fabs(up.z) && std::fabs(up.y) > std::fabs(up.x);
  const Vec3d front = y_up ? Vec3d{0, 0, -1} : Vec3d{0, 1, 0};
  return Unit(front - up * Dot(front, up));
}

}  // namespace

Vec3d UpOfView(Vec3d direction, Vec3d up) {
  const Vec3d forward = Unit(direction), line = Unit(up);
  if (std::fabs(Dot(forward, line)) < 0.999) return up;
  return FrontDirection(line) * (Dot(forward, line) < 0 ? 1.0 : -1.0);
}

Vec3d ViewDirection(std::string_view name, Vec3d up, std::span<const Vec3d> points) {
  up = Unit(up);
  const Vec3d front = FrontDirection(up), right = Cross(front, up);
  if (name == "front") return front;
  if (name == "back") return front * -1.0;
  if (name == "left") return right;
  if (name == "right") return right * -1.0;
  if (name == "top") return up * -1.0;
  if (name == "bottom") return up;
  if (name == "iso") return Unit(front - right - up);
  const double width = ExtentAlong(points, right), depth = ExtentAlong(points, front);
  const bool broad = depth > kBroader * width;
  const bool flat = ExtentAlong(points, up) < kFlat * (broad ? depth : width);
  return Unit(front * (broad ? 0.42 : 0.86) - right * (broad ? 0.86 : 0.42) -
              up * (flat ? 0.8 : 0.34));
}

}  // namespace mtdb
