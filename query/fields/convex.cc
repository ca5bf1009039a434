// SPDX-License-Identifier: Apache-2.0
#include "query/fields/convex.h"

#include <algorithm>
#include <cmath>

#include "query/fields/rounding.h"
#include "query/fields/work_meter.h"
#include "store/base/check.h"

namespace mtdb::internal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kParallel = 1e-9;  // sine of the angle between two planes
constexpr double kNoSlope = 1e-14;  // of a line towards a plane

double Scale(const Triangle3d& t, double distance) {
  return std::max(
      {LargestCoordinate(t[0]), LargestCoordinate(t[1]), LargestCoordinate(t[2]), distance});
}

// Of a box with such half sides along a direction, from its middle.
double Reach(Vec3d half, Vec3d n) {
  return half.x * std::abs(n.x) + half.y * std::abs(n.y) + half.z * std::abs(n.z);
}

}  // namespace

Convex::Heights Convex::Plane::HeightsIn(const Box3d& box) const {
  const Vec3d half = (box.max - box.min) * 0.5;
  return {Height((box.min + box.max) * 0.5), Reach(half, half_space.normal)};
}

// The distance of a triangle and a polyhedron that do not meet is that of a corner and a face, an
// edge and an edge, or a corner of the polyhedron (an end of its edges) and the triangle. They meet
// when an edge of one meets the other. So planes and edges are all that is needed, and nothing has
// to be bounded.
Convex::Convex(const std::vector<HalfSpace>& half_spaces) {
  MTDB_CHECK(half_spaces.size() <= kMaxHalfSpaces, "too many half-spaces");
  for (const HalfSpace& h : half_spaces) {
    const double largest = LargestCoordinate(h.normal);
    MTDB_CHECK(largest > 0 && std::isfinite(largest) && std::isfinite(LargestCoordinate(h.point)),
               "a half-space needs a finite point and a normal");
    const Vec3d normal = h.normal * (1 / largest);
    planes_.push_back({{h.point, normal * (1 / Length(normal))}, LargestCoordinate(h.point)});
  }
  FindEdges();
  FindBounds();
}

void Convex::FindEdges() {
  for (size_t i = 0; i < planes_.size(); ++i) {
    for (size_t j = i + 1; j < planes_.size(); ++j) {
      const HalfSpace& a = planes_[i].half_space;
      const HalfSpace& b = planes_[j].half_space;
      const Vec3d along = Cross(a.normal, b.normal);
      const double sine = Length(along);
      if (sine < kParallel) continue;
      // The point of both planes that is nearest to a.point.
      const Vec3d towards = b.normal - a.normal * Dot(a.normal, b.normal);
      const Vec3d origin = a.point + towards * (Dot(b.normal, b.point - a.point) / (sine * sine));
      const double scale =
          std::max({planes_[i].scale, planes_[j].scale, LargestCoordinate(origin)});
      Line line{origin, along * (1 / sine), -kInfinity, kInfinity, scale};
      if (Clip(line)) edges_.push_back(line);
    }
  }
}

// A polyhedron with a corner is spanned by its corners and its infinite edges; one without contains
// a whole line.
void Convex::FindBounds() {
  const Vec3d all{kInfinity, kInfinity, kInfinity};
  for (const Line& e : edges_) {
    for (const double s : {e.begin, e.end}) {
      Vec3d p = e.origin;
      for (int i = 0; i < 3; ++i) {
        if (e.direction[i] != 0) p[i] += e.direction[i] * s;
      }
      const double slack = kBoxRounding * e.scale;
      bounds_.Add(p - Vec3d{slack, slack, slack});
      bounds_.Add(p + Vec3d{slack, slack, slack});
    }
  }
  const bool has_corner = std::any_of(edges_.begin(), edges_.end(), [](const Line& e) {
    return std::isfinite(e.begin) || std::isfinite(e.end);
  });
  if (!has_corner) bounds_ = {all * -1.0, all};
}

bool Convex::Clip(Line& line) const {
  for (const Plane& p : planes_) {
    const double height = p.Height(line.origin);
    const double slope = Dot(p.half_space.normal, line.direction);
    const double slack = kTriangleRounding * std::max(p.scale, line.scale);
    if (std::abs(slope) < kNoSlope) {
      if (height > slack) return false;
    } else if (slope > 0) {
      line.end = std::min(line.end, (slack - height) / slope);
    } else {
      line.begin = std::max(line.begin, (slack - height) / slope);
    }
  }
  return line.begin <= line.end;
}

bool Convex::Within(const Triangle3d& t, double distance) const {
  const double scale = Scale(t, distance);
  bool inside[3] = {true, true, true};
  for (const Plane& p : planes_) {
    const double slack = kTriangleRounding * std::max(p.scale, scale);
    double lowest = kInfinity;
    for (size_t c = 0; c < 3; ++c) {
      const double height = p.Height(t[c]);
      lowest = std::min(lowest, height);
      inside[c] = inside[c] && height <= slack;
    }
    if (lowest > distance + slack) return false;
  }
  return inside[0] || inside[1] || inside[2] || MeetsEdge(t, scale) ||
         NearFace(t, distance, scale) || NearEdge(t, distance, scale);
}

bool Convex::MeetsEdge(const Triangle3d& t, double scale) const {
  for (size_t c = 0; c < 3; ++c) {
    const Vec3d edge = t[(c + 1) % 3] - t[c];
    const double length = Length(edge);
    if (length == 0) continue;
    Line line{t[c], edge * (1 / length), 0, length, scale};
    if (Clip(line)) return true;
  }
  return false;
}

bool Convex::NearFace(const Triangle3d& t, double distance, double scale) const {
  for (const Plane& p : planes_) {
    if (!SpendSteps(1)) return false;
    const double limit = distance + kTriangleRounding * std::max(p.scale, scale);
    for (const Vec3d& corner : t) {
      const double height = p.Height(corner);
      if (height < 0 || height > limit) continue;
      const Vec3d foot = corner - p.half_space.normal * height;
      const bool in_face = std::all_of(planes_.begin(), planes_.end(), [&](const Plane& other) {
        return other.Height(foot) <= kTriangleRounding * std::max({other.scale, p.scale, scale});
      });
      if (in_face) return true;
    }
  }
  return false;
}

bool Convex::NearEdge(const Triangle3d& t, double distance, double scale) const {
  for (const Line& e : edges_) {
    if (!SpendSteps(1)) return false;
    const double limit = distance + kTriangleRounding * std::max(e.scale, scale);
    // The part that can be nearest to a point of the triangle.
    double low = kInfinity;
    double high = -kInfinity;
    for (const Vec3d& corner : t) {
      const double s = std::clamp(Dot(corner - e.origin, e.direction), e.begin, e.end);
      low = std::min(low, s);
      high = std::max(high, s);
    }
    const Vec3d a = e.origin + e.direction * low;
    const Vec3d b = e.origin + e.direction * high;
    if (SquaredDistanceSegmentTriangle(a, b, t) <= limit * limit) return true;
  }
  return false;
}

bool Convex::Covers(const Triangle3d& t, double distance) const {
  const double scale = Scale(t, distance);
  return std::all_of(planes_.begin(), planes_.end(), [&](const Plane& p) {
    const double limit = -distance - kTriangleRounding * std::max(p.scale, scale);
    return p.Height(t[0]) < limit && p.Height(t[1]) < limit && p.Height(t[2]) < limit;
  });
}

bool Convex::BoxWithin(const Box3d& box, double distance) const {
  if (box.empty()) return false;
  const double around = distance + Rounding(box, distance, 0);
  if (SquaredDistanceBoxBox(box, bounds_) > around * around) return false;
  return std::all_of(planes_.begin(), planes_.end(), [&](const Plane& p) {
    return p.HeightsIn(box).Lowest() <= distance + Rounding(box, distance, p.scale);
  });
}

bool Convex::BoxCovers(const Box3d& box, double distance) const {
  if (box.empty()) return false;
  return std::all_of(planes_.begin(), planes_.end(), [&](const Plane& p) {
    return p.HeightsIn(box).Highest() < -distance - Rounding(box, distance, p.scale);
  });
}

double Convex::Depth(const Box3d& box) const {
  if (box.empty()) return 0;
  double inside = kInfinity;  // of all planes
  double outside = 0;         // of one of them
  for (const Plane& p : planes_) {
    const Heights heights = p.HeightsIn(box);
    const double slack = 4 * Rounding(box, std::abs(heights.middle), p.scale);
    inside = std::min(inside, -heights.Highest() - slack);
    outside = std::max(outside, heights.Lowest() - slack);
  }
  return outside > 0 ? -outside : std::max(0.0, inside);
}

// The depths of boxes inside `within` come from planes whose heights there are not all below those
// of another one: the others may move as they like. Heights over a plane are linear, so that their
// change is largest at a corner.
double Convex::Shift(const Region& to, const Box3d& within) const {
  const auto* const other = dynamic_cast<const Convex*>(&to);
  if (other == nullptr || other->planes_.size() != planes_.size() || within.empty()) {
    return Region::Shift(to, within);
  }
  if (other->planes_ == planes_) return 0;
  const double highest = HighestPlane(within);
  const double highest_into = other->HighestPlane(within);
  double shift = 0;
  for (size_t i = 0; i < planes_.size(); ++i) {
    const Plane& a = planes_[i];
    const Plane& b = other->planes_[i];
    const Heights from = a.HeightsIn(within);
    const Heights into = b.HeightsIn(within);
    const double slack =
        16 * Rounding(within, std::max(from.Size(), into.Size()), std::max(a.scale, b.scale));
    if (from.Highest() + slack < highest && into.Highest() + slack < highest_into) continue;
    const Vec3d half = (within.max - within.min) * 0.5;
    const Vec3d turn = b.half_space.normal - a.half_space.normal;
    const double step = std::abs(into.middle - from.middle) + Reach(half, turn);
    shift = std::max(shift, step + slack);
  }
  return shift;
}

double Convex::HighestPlane(const Box3d& box) const {
  double highest = -kInfinity;
  for (const Plane& p : planes_) highest = std::max(highest, p.HeightsIn(box).Lowest());
  return highest;
}

std::vector<HalfSpace> Convex::HalfSpaces() const {
  std::vector<HalfSpace> all;
  for (const Plane& p : planes_) all.push_back(p.half_space);
  return all;
}

std::vector<HalfSpace> BoxHalfSpaces(const Box3d& box) {
  std::vector<HalfSpace> all;
  for (int i = 0; i < 3; ++i) {
    Vec3d normal;
    normal[i] = 1;
    all.push_back({box.max, normal});
    all.push_back({box.min, normal * -1.0});
  }
  return all;
}

}  // namespace mtdb::internal
