// SPDX-License-Identifier: Apache-2.0
#include "query/ask/probe_geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace mtdb::internal {
namespace {

Vec3d ClosestPointOfSegment(Vec3d p, Vec3d a, Vec3d b) {
  const Vec3d ab = b - a;
  const double length2 = SquaredLength(ab);
  return length2 > 0 ? a + ab * std::clamp(Dot(p - a, ab) / length2, 0.0, 1.0) : a;
}

Box3d BoundsOf(const Triangle3d& t) {
  Box3d box;
  for (const Vec3d& p : t) box.Add(p);
  return box;
}

class RayPart final : public Region {
 public:
  RayPart(const RayCaster& ray, double begin, double end)
      : ray_(ray), begin_(begin), end_(end), a_(ray.At(begin)), b_(ray.At(end)) {
    bounds_.Add(a_);
    bounds_.Add(b_);
    for (const Vec3d& p : {ray.At(0), a_, b_}) {
      slack_ = std::max({slack_, std::abs(p.x), std::abs(p.y), std::abs(p.z)});
    }
    slack_ *= kSlack;
  }

  bool Within(const Triangle3d& t, double distance) const override {
    const double limit = (slack_ + distance) * (slack_ + distance);
    if (SquaredDistanceBoxBox(BoundsOf(t), bounds_) > limit) return false;
    const std::optional<double> hit = ray_.Hit(t);
    if (hit && *hit >= begin_ && *hit <= end_) return true;
    for (const Vec3d& end : {a_, b_}) {
      if (SquaredDistancePointTriangle(end, t[0], t[1], t[2]) <= limit) return true;
    }
    for (size_t i = 0; i < 3; ++i) {
      if (SquaredDistanceSegmentSegment(a_, b_, t[i], t[(i + 1) % 3]) <= limit) return true;
    }
    return false;
  }

  bool Covers(const Triangle3d&, double) const override { return false; }
  bool BoxCovers(const Box3d&, double) const override { return false; }

  // By the ball around the box: never too far.
  bool BoxWithin(const Box3d& box, double distance) const override {
    if (box.empty()) return false;
    const Vec3d centre = (box.min + box.max) * 0.5;
    const double radius = Length(box.max - centre);
    const double near = slack_ + distance + (radius + Length(centre)) * kSlack;
    if (SquaredDistanceBoxBox(box, bounds_) > near * near) return false;
    const double limit = near + radius;
    return SquaredDistancePointSegment(centre, a_, b_) <= limit * limit;
  }

 private:
  static constexpr double kSlack = 1e-12;  // of the largest coordinate
  RayCaster ray_;
  double begin_, end_;
  Vec3d a_, b_;
  Box3d bounds_;
  double slack_ = 0;
};

}  // namespace

// After C. Ericson, "Real-Time Collision Detection" (2005), 5.1.5; in needles, where the rounded
// barycentric coordinates may name a point that is not the nearest, an edge may be nearer.
Vec3d ClosestPointOfTriangle(Vec3d p, const Triangle3d& t) {
  Vec3d best = t[0];
  double best2 = SquaredLength(p - best);
  const auto consider = [&](Vec3d q) {
    const double d2 = SquaredLength(p - q);
    if (d2 < best2) {
      best2 = d2;
      best = q;
    }
  };
  for (size_t i = 0; i < 3; ++i) consider(ClosestPointOfSegment(p, t[i], t[(i + 1) % 3]));
  const Vec3d normal = Cross(t[1] - t[0], t[2] - t[0]);
  const double u = Dot(Cross(t[2] - t[1], p - t[1]), normal);
  const double v = Dot(Cross(t[0] - t[2], p - t[2]), normal);
  const double w = Dot(Cross(t[1] - t[0], p - t[0]), normal);
  if (u > 0 && v > 0 && w > 0) {
    const double sum = u + v + w;
    consider(t[0] + (t[1] - t[0]) * (v / sum) + (t[2] - t[0]) * (w / sum));
  }
  return best;
}

RayCaster::RayCaster(Vec3d origin, Vec3d direction) : origin_(origin), direction_(direction) {
  z_ = 0;
  for (int i = 1; i < 3; ++i) {
    if (std::abs(direction[i]) > std::abs(direction[z_])) z_ = i;
  }
  x_ = (z_ + 1) % 3;
  y_ = (z_ + 2) % 3;
  shear_x_ = direction[x_] / direction[z_];
  shear_y_ = direction[y_] / direction[z_];
  scale_z_ = 1 / direction[z_];
}

Vec3d RayCaster::Shear(Vec3d p) const {
  const Vec3d q = p - origin_;
  return {q[x_] - shear_x_ * q[z_], q[y_] - shear_y_ * q[z_], scale_z_ * q[z_]};
}

std::optional<double> RayCaster::Hit(const Triangle3d& t) const {
  const Vec3d a = Shear(t[0]);
  const Vec3d b = Shear(t[1]);
  const Vec3d c = Shear(t[2]);
  // Each is opposite, bit for bit, for the triangle on the edge's other side.
  const double u = c.x * b.y - c.y * b.x;
  const double v = a.x * c.y - a.y * c.x;
  const double w = b.x * a.y - b.y * a.x;
  if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) return std::nullopt;
  const double sum = u + v + w;
  if (sum == 0) return std::nullopt;
  const double hit = (u / sum) * a.z + (v / sum) * b.z + (w / sum) * c.z;
  if (!(hit >= 0)) return std::nullopt;
  return hit;
}

std::optional<RayCaster::Interval> RayCaster::Clip(const Box3d& box) const {
  if (box.empty()) return std::nullopt;
  Interval in{0, std::numeric_limits<double>::infinity()};
  for (int i = 0; i < 3; ++i) {
    if (direction_[i] == 0) {
      if (origin_[i] < box.min[i] || origin_[i] > box.max[i]) return std::nullopt;
      continue;
    }
    double first = (box.min[i] - origin_[i]) / direction_[i];
    double last = (box.max[i] - origin_[i]) / direction_[i];
    if (first > last) std::swap(first, last);
    in.begin = std::max(in.begin, first);
    in.end = std::min(in.end, last);
  }
  if (!(in.begin <= in.end)) return std::nullopt;
  return in;
}

RegionPtr RayRegion(const RayCaster& ray, double begin, double end) {
  return std::make_shared<RayPart>(ray, begin, end);
}

}  // namespace mtdb::internal
