// SPDX-License-Identifier: Apache-2.0
// Regions that are convex polyhedra: half-spaces, frusta, wedges.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "query/fields/convex.h"
#include "store/base/check.h"

namespace mtdb {

using namespace internal;

namespace {

void CheckCamera(const Camera& camera) {
  const Status status = camera.Validate();
  MTDB_CHECK(status.ok(), status.message().c_str());
}

// The corners of the convex hull of points in the plane, counterclockwise. After A. M. Andrew,
// "Another efficient algorithm for convex hulls in two dimensions" (1979).
std::vector<Vec3d> Hull(std::vector<Vec3d> points) {
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  std::vector<Vec3d> hull;
  for (const bool upper : {false, true}) {
    const size_t first = hull.size();
    for (const Vec3d& p : points) {
      while (hull.size() >= first + 2 &&
             Cross(hull.back() - hull[hull.size() - 2], p - hull.back()).z <= 0) {
        hull.pop_back();
      }
      hull.push_back(p);
    }
    hull.pop_back();
    if (!upper) std::reverse(points.begin(), points.end());
  }
  return hull;
}

}  // namespace

RegionPtr HalfSpaceRegion(const HalfSpace& half_space) { return ConvexRegion({half_space}); }

RegionPtr ConvexRegion(const std::vector<HalfSpace>& half_spaces) {
  if (half_spaces.empty()) return WholeRegion();
  return std::make_shared<Convex>(half_spaces);
}

RegionPtr FrustumRegion(const Camera& camera) {
  CheckCamera(camera);
  const Camera::Axes a = camera.axes();
  const double x = camera.tangent_x();
  const double y = camera.tangent_y();
  std::vector<HalfSpace> sides{{camera.eye, a.right - a.forward * x},
                               {camera.eye, a.right * -1.0 - a.forward * x},
                               {camera.eye, a.up - a.forward * y},
                               {camera.eye, a.up * -1.0 - a.forward * y}};
  if (camera.near > 0) sides.push_back({camera.eye + a.forward * camera.near, a.forward * -1.0});
  if (std::isfinite(camera.far)) {
    sides.push_back({camera.eye + a.forward * camera.far, a.forward});
  }
  return ConvexRegion(sides);
}

RegionPtr FrustumShadowRegion(const Camera& camera) {
  CheckCamera(camera);
  MTDB_CHECK(std::isfinite(camera.far), "the shadow of a frustum needs a finite far");
  const Camera::Axes a = camera.axes();
  std::vector<Vec3d> corners;
  for (const double depth : {camera.near, camera.far}) {
    for (const double x : {-1.0, 1.0}) {
      for (const double y : {-1.0, 1.0}) {
        const Vec3d p = camera.eye + (a.forward + a.right * (x * camera.tangent_x()) +
                                      a.up * (y * camera.tangent_y())) *
                                         depth;
        corners.push_back({p.x, p.y, 0});
      }
    }
  }
  const std::vector<Vec3d> hull = Hull(std::move(corners));
  std::vector<HalfSpace> sides;
  for (size_t i = 0; i < hull.size(); ++i) {
    const Vec3d edge = hull[(i + 1) % hull.size()] - hull[i];
    sides.push_back({hull[i], {edge.y, -edge.x, 0}});
  }
  return ConvexRegion(sides);
}

RegionPtr WedgeRegion(const Wedge& wedge) {
  const double length = std::hypot(wedge.direction_x, wedge.direction_y);
  MTDB_CHECK(length > 0 && std::isfinite(length), "a wedge needs a direction");
  MTDB_CHECK(wedge.angle_rad > 0 && wedge.angle_rad < std::numbers::pi,
             "a wedge's angle is above 0 and below pi");
  MTDB_CHECK(wedge.near >= 0 && wedge.far > wedge.near, "a wedge's far is beyond its near");
  const Vec3d apex{wedge.apex_x, wedge.apex_y, 0};
  const Vec3d forward{wedge.direction_x / length, wedge.direction_y / length, 0};
  const Vec3d right{forward.y, -forward.x, 0};
  const double cosine = std::cos(wedge.angle_rad / 2);
  const double sine = std::sin(wedge.angle_rad / 2);
  std::vector<HalfSpace> sides{{apex, right * cosine - forward * sine},
                               {apex, right * -cosine - forward * sine}};
  if (wedge.near > 0) sides.push_back({apex + forward * wedge.near, forward * -1.0});
  if (std::isfinite(wedge.far)) sides.push_back({apex + forward * wedge.far, forward});
  return ConvexRegion(sides);
}

}  // namespace mtdb
