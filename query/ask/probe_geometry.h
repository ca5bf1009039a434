// SPDX-License-Identifier: Apache-2.0
// What probes ask of a single triangle, and the part of a ray as a region.
#pragma once

#include <optional>

#include "query/region.h"
#include "store/base/geometry.h"

namespace mtdb::internal {

// The point of the triangle that is closest to `p`. Degenerate triangles are segments or points.
Vec3d ClosestPointOfTriangle(Vec3d p, const Triangle3d& t);

// A ray prepared for many triangles. After Woop, Benthin, Wald, "Watertight Ray/Triangle
// Intersection" (2013): space is sheared so that the ray is an axis; signs on a shared edge are
// opposite for both triangles, and 0 counts as inside. We reckon in double and do not fall back to
// more digits.
class RayCaster {
 public:
  // `direction` is finite and not 0.
  RayCaster(Vec3d origin, Vec3d direction);

  // The parameter t >= 0 where the ray meets the triangle, edges and corners included.
  std::optional<double> Hit(const Triangle3d& t) const;
  // The parameters between which the ray is inside the box, 0 or more; nullopt when it misses it.
  struct Interval {
    double begin, end;
  };
  std::optional<Interval> Clip(const Box3d& box) const;

  Vec3d At(double t) const { return origin_ + direction_ * t; }
  double length() const { return Length(direction_); }  // of the direction

 private:
  Vec3d Shear(Vec3d p) const;

  Vec3d origin_;
  Vec3d direction_;
  int x_, y_, z_;  // axes; z_ is the one along which the direction is longest
  double shear_x_, shear_y_, scale_z_;
};

// The points of the ray from parameter `begin` to `end`, and what is closer to them than rounding
// can tell: every triangle that the ray hits there meets the region.
RegionPtr RayRegion(const RayCaster& ray, double begin, double end);

}  // namespace mtdb::internal
