// SPDX-License-Identifier: Apache-2.0
// Overlay: what two triangles and a rectangle have in common, seen from above.
#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "store/base/geometry.h"

namespace mtdb::internal {

// A rectangle of the plane.
struct PlaneWindow {
  double min_x = 0, min_y = 0, max_x = 0, max_y = 0;

  double area() const { return (max_x - min_x) * (max_y - min_y); }
  bool empty() const { return !(min_x < max_x && min_y < max_y); }
};

// A triangle of a height field, seen from above.
class PlaneTriangle {
 public:
  explicit PlaneTriangle(const Triangle3d& t);

  const Triangle3d& corners() const { return corners_; }
  // The height at a place inside of it; never beyond those of its corners.
  double HeightAt(double x, double y) const;
  // By how much a height is off that was asked for at a place which rounding moved by `moved`.
  double HeightSlack(double moved) const;

 private:
  Triangle3d corners_;  // in the order of the clock's opposite
  double slope_ = 0;
  double range_ = 0;  // of its heights
};

// A convex polygon of the plane; corners in the order of the clock's opposite. z means nothing.
class PlanePolygon {
 public:
  explicit PlanePolygon(const PlaneTriangle& t);

  std::span<const Vec3d> corners() const { return {corners_.data(), size_}; }
  bool empty() const { return size_ < 3; }
  double area() const;
  void ClipTo(const PlaneWindow& window);
  void ClipTo(const PlaneTriangle& t);

 private:
  // Keeps where `side`, a linear function, is not negative; after Sutherland and Hodgman,
  // "Reentrant polygon clipping" (1974).
  template <typename Side>
  void Clip(const Side& side);

  static constexpr size_t kMost = 12;  // 3 corners, and one more for each of up to 7 lines
  std::array<Vec3d, kMost> corners_;
  size_t size_ = 0;
};

}  // namespace mtdb::internal
