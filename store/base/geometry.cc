// SPDX-License-Identifier: Apache-2.0
#include "store/base/geometry.h"

#include "store/base/nearest_places.h"

namespace mtdb {

double SquaredDistancePointBox(Vec3d p, const Box3d& box) {
  double d2 = 0;
  for (int i = 0; i < 3; ++i) {
    const double d = std::max({box.min[i] - p[i], 0.0, p[i] - box.max[i]});
    d2 += d * d;
  }
  return d2;
}

double SquaredDistanceBoxBox(const Box3d& a, const Box3d& b) {
  double d2 = 0;
  for (int i = 0; i < 3; ++i) {
    const double d = std::max({a.min[i] - b.max[i], 0.0, b.min[i] - a.max[i]});
    d2 += d * d;
  }
  return d2;
}

double NearestOnSegment(Vec3d p, Vec3d a, Vec3d b) {
  const Vec3d ab = b - a;
  const double length2 = SquaredLength(ab);
  return length2 > 0 ? std::clamp(Dot(p - a, ab) / length2, 0.0, 1.0) : 0.0;
}

double SquaredDistancePointSegment(Vec3d p, Vec3d a, Vec3d b) {
  return SquaredLength(p - (a + (b - a) * NearestOnSegment(p, a, b)));
}

// After C. Ericson, "Real-Time Collision Detection" (2005), 5.1.9; with cross products instead of
// differences of products, which keep their digits when the segments are nearly parallel.
std::array<double, 2> NearestOnSegments(Vec3d a, Vec3d b, Vec3d c, Vec3d d) {
  const Vec3d u = b - a;
  const Vec3d v = d - c;
  const Vec3d r = a - c;
  const double uu = Dot(u, u);
  const double vv = Dot(v, v);
  if (uu <= 0) return {0, NearestOnSegment(a, c, d)};
  if (vv <= 0) return {NearestOnSegment(c, a, b), 0};
  const Vec3d normal = Cross(u, v);
  const double denominator = SquaredLength(normal);
  const double ur = Dot(u, r);
  const double uv = Dot(u, v);
  double s = denominator > 0 ? std::clamp(Dot(normal, Cross(v, r)) / denominator, 0.0, 1.0) : 0.0;
  double t = (uv * s + Dot(v, r)) / vv;
  if (t < 0) {
    t = 0;
    s = std::clamp(-ur / uu, 0.0, 1.0);
  } else if (t > 1) {
    t = 1;
    s = std::clamp((uv - ur) / uu, 0.0, 1.0);
  }
  return {s, t};
}

double SquaredDistanceSegmentSegment(Vec3d a, Vec3d b, Vec3d c, Vec3d d) {
  const auto [s, t] = NearestOnSegments(a, b, c, d);
  return SquaredLength((a + (b - a) * s) - (c + (d - c) * t));
}

// After C. Ericson, "Real-Time Collision Detection" (2005), 5.1.5.
double SquaredDistancePointTriangle(Vec3d p, Vec3d a, Vec3d b, Vec3d c) {
  const Vec3d ab = b - a;
  const Vec3d ac = c - a;
  const Vec3d ap = p - a;
  const double d1 = Dot(ab, ap);
  const double d2 = Dot(ac, ap);
  if (d1 <= 0 && d2 <= 0) return SquaredLength(ap);
  const Vec3d bp = p - b;
  const double d3 = Dot(ab, bp);
  const double d4 = Dot(ac, bp);
  if (d3 >= 0 && d4 <= d3) return SquaredLength(bp);
  const Vec3d cp = p - c;
  const double d5 = Dot(ab, cp);
  const double d6 = Dot(ac, cp);
  if (d6 >= 0 && d5 <= d6) return SquaredLength(cp);
  const double vc = d1 * d4 - d3 * d2;
  const double vb = d5 * d2 - d1 * d6;
  const double va = d3 * d6 - d5 * d4;
  const double sum = va + vb + vc;
  const auto edges = [&] {
    return std::min({SquaredDistancePointSegment(p, a, b), SquaredDistancePointSegment(p, b, c),
                     SquaredDistancePointSegment(p, c, a)});
  };
  if (!(va > 0 && vb > 0 && vc > 0 && sum > 0)) return edges();
  const double inside = SquaredLength(ap - ab * (vb / sum) - ac * (vc / sum));
  // In needles the barycentric coordinates are rounding noise: what they name is a point of the
  // triangle, but not the nearest.
  constexpr double kNoise = 1e-6;
  const double far2 = std::max({SquaredLength(ap), SquaredLength(bp), SquaredLength(cp)});
  const bool thin =
      sum * sum < kNoise * kNoise * SquaredLength(ab) * SquaredLength(ac) * far2 * far2;
  return thin ? std::min(inside, edges()) : inside;
}

double SquaredDistanceSegmentTriangle(Vec3d p, Vec3d q, const Triangle3d& t) {
  double best = std::min(SquaredDistancePointTriangle(p, t[0], t[1], t[2]),
                         SquaredDistancePointTriangle(q, t[0], t[1], t[2]));
  for (size_t e = 0; e < 3; ++e) {
    best = std::min(best, SquaredDistanceSegmentSegment(p, q, t[e], t[(e + 1) % 3]));
  }
  // Where the segment crosses the plane, it may cross the triangle.
  const Vec3d normal = Cross(t[1] - t[0], t[2] - t[0]);
  const double above_p = Dot(p - t[0], normal);
  const double above_q = Dot(q - t[0], normal);
  if ((above_p < 0) == (above_q < 0) || above_p == above_q) return best;
  const Vec3d crossing = p + (q - p) * (above_p / (above_p - above_q));
  return std::min(best, SquaredDistancePointTriangle(crossing, t[0], t[1], t[2]));
}

namespace {

// The part of the box that can be nearest to the triangle. Bounded when the triangle is, whatever
// the box, and no larger than the triangle, so that nothing is lost to rounding.
Box3d NearPart(const Box3d& box, const Triangle3d& t) {
  Box3d near;
  for (int i = 0; i < 3; ++i) {
    near.min[i] = std::clamp(std::min({t[0][i], t[1][i], t[2][i]}), box.min[i], box.max[i]);
    near.max[i] = std::clamp(std::max({t[0][i], t[1][i], t[2][i]}), box.min[i], box.max[i]);
  }
  return near;
}

}  // namespace

bool TriangleMeetsBox(const Triangle3d& t, const Box3d& whole_box) {
  if (whole_box.empty()) return false;
  const Box3d box = NearPart(whole_box, t);
  const Vec3d centre = (box.min + box.max) * 0.5;
  const Vec3d half = (box.max - box.min) * 0.5;
  const Vec3d v[3] = {t[0] - centre, t[1] - centre, t[2] - centre};
  for (int i = 0; i < 3; ++i) {
    if (std::min({v[0][i], v[1][i], v[2][i]}) > half[i]) return false;
    if (std::max({v[0][i], v[1][i], v[2][i]}) < -half[i]) return false;
  }
  const Vec3d edge[3] = {v[1] - v[0], v[2] - v[1], v[0] - v[2]};
  const auto separated = [&](Vec3d axis) {
    const double p0 = Dot(v[0], axis);
    const double p1 = Dot(v[1], axis);
    const double p2 = Dot(v[2], axis);
    const double r =
        half.x * std::abs(axis.x) + half.y * std::abs(axis.y) + half.z * std::abs(axis.z);
    return std::min({p0, p1, p2}) > r || std::max({p0, p1, p2}) < -r;
  };
  if (separated(Cross(edge[0], edge[1]))) return false;
  for (const Vec3d& e : edge) {
    if (separated({0, -e.z, e.y}) || separated({e.z, 0, -e.x}) || separated({-e.y, e.x, 0})) {
      return false;
    }
  }
  return true;
}

double SquaredDistanceTriangleBox(const Triangle3d& t, const Box3d& whole_box) {
  if (whole_box.empty()) return std::numeric_limits<double>::infinity();
  if (TriangleMeetsBox(t, whole_box)) return 0;
  const Box3d box = NearPart(whole_box, t);
  double best = std::numeric_limits<double>::infinity();
  for (const Vec3d& p : t) best = std::min(best, SquaredDistancePointBox(p, box));
  const auto corner = [&](int i) {
    return Vec3d{(i & 1) ? box.max.x : box.min.x, (i & 2) ? box.max.y : box.min.y,
                 (i & 4) ? box.max.z : box.min.z};
  };
  for (int i = 0; i < 8; ++i) {
    best = std::min(best, SquaredDistancePointTriangle(corner(i), t[0], t[1], t[2]));
    for (int axis = 1; axis < 8; axis <<= 1) {
      if (i & axis) continue;
      for (int e = 0; e < 3; ++e) {
        best = std::min(
            best, SquaredDistanceSegmentSegment(corner(i), corner(i | axis), t[e], t[(e + 1) % 3]));
      }
    }
  }
  return best;
}

}  // namespace mtdb
