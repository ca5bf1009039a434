// SPDX-License-Identifier: Apache-2.0
#include "store/base/estimate_up.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace mtdb {

namespace {

// An open surface whose area, as a vector, is this share of its area faces one side, as terrain and
// reliefs do.
constexpr double kFacesOneSide = 0.4;
constexpr double kAlmostAxis = 0.9;  // cosine
constexpr double kSlab = 0.03;       // of the extent: what touches the ground
// What stands has a base of this share of its outline; the scans that this was tried on have 0.36
// to 0.93, and less than 0.15 on their other sides.
constexpr double kBase = 0.25;
constexpr double kBetter = 1.1;
constexpr double kFlat = 0.3;

Vec3d Unit(Vec3d v) {
  const double n = Length(v);
  return n > 0 ? v * (1 / n) : Vec3d{0, 0, 1};
}

struct Point2 {
  double x, y;
};

// Of the convex hull.
double HullArea(std::vector<Point2> points) {
  const auto cross = [](Point2 o, Point2 a, Point2 b) {
    return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x);
  };
  std::ranges::sort(points,
                    [](Point2 a, Point2 b) { return a.x < b.x || (a.x == b.x && a.y < b.y); });
  double area = 0;
  for (int side = 0; side < 2; ++side) {
    std::vector<Point2> hull;
    for (const Point2 p : points) {
      while (hull.size() > 1 && cross(hull[hull.size() - 2], hull.back(), p) <= 0) hull.pop_back();
      hull.push_back(p);
    }
    for (size_t i = 1; i < hull.size(); ++i) {
      area += (hull[i - 1].x * hull[i].y - hull[i].x * hull[i - 1].y) / 2;
    }
    std::ranges::reverse(points);
  }
  return area;
}

// How well the mesh stands with `axis` (0 .. 2) up or down: the share of its outline, seen from
// above, that the hull of what touches the ground takes.
double Standing(const TriangleMesh& mesh, const Box3d& bounds, size_t axis, bool up) {
  const int a = static_cast<int>(axis), u = (a + 1) % 3, v = (a + 2) % 3;
  const double extent = bounds.max[a] - bounds.min[a];
  const double ground = up ? bounds.min[a] : bounds.max[a];
  std::vector<Point2> all, touching;
  for (const TriangleVertices& t : mesh.triangles) {
    for (const VertexIndex vertex : t) {
      const Vec3d p = mesh.positions[vertex] - bounds.min;
      const Point2 flat{p[u], p[v]};
      all.push_back(flat);
      if (std::fabs(mesh.positions[vertex][a] - ground) <= kSlab * extent) touching.push_back(flat);
    }
  }
  const double whole = HullArea(std::move(all));
  return whole > 0 ? HullArea(std::move(touching)) / whole : 0;
}

Vec3d Axis(size_t axis, double sign) {
  Vec3d v;
  v[static_cast<int>(axis)] = sign;
  return v;
}

// For an open surface that faces `direction`. Flat ones lie; others are scans of one side of
// something that stands. Triangles of terrain are often listed the wrong way round, so of the
// directions along z the usual one is meant.
Vec3d UpOfOpen(Vec3d direction, const TriangleMesh& mesh) {
  const double height = ExtentAlong(mesh.positions, direction);
  const Vec3d u =
      Unit(Cross(std::fabs(direction.z) < 0.9 ? Vec3d{0, 0, 1} : Vec3d{1, 0, 0}, direction));
  const double width =
      std::max(ExtentAlong(mesh.positions, u), ExtentAlong(mesh.positions, Cross(direction, u)));
  const bool lies = height < kFlat * width;
  if (!lies && std::fabs(direction.z) > kAlmostAxis) return {0, 1, 0};
  if (!lies) return {0, 0, 1};
  if (std::fabs(direction.z) > kAlmostAxis) return {0, 0, 1};
  for (const size_t axis : {size_t{0}, size_t{1}}) {
    const double d = direction[static_cast<int>(axis)];
    if (std::fabs(d) > kAlmostAxis) return Axis(axis, d > 0 ? 1 : -1);
  }
  return direction;
}

}  // namespace

double ExtentAlong(std::span<const Vec3d> points, Vec3d along) {
  double least = 1e300, most = -1e300;
  for (const Vec3d p : points) {
    least = std::min(least, Dot(p, along));
    most = std::max(most, Dot(p, along));
  }
  return points.empty() ? 0 : most - least;
}

Vec3d EstimateUp(const TriangleMesh& mesh) {
  Box3d bounds;
  Vec3d sum;
  double area = 0;
  for (const TriangleVertices& t : mesh.triangles) {
    const Vec3d a = mesh.positions[t[0]];
    const Vec3d twice = Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a);
    sum += twice;
    area += Length(twice);
    for (const VertexIndex v : t) bounds.Add(mesh.positions[v]);
  }
  if (!(area > 0)) return {0, 0, 1};
  if (Length(sum) > kFacesOneSide * area) return UpOfOpen(Unit(sum), mesh);
  Vec3d best{0, 0, 1};
  double most = 0;
  for (const size_t axis : {size_t{2}, size_t{1}, size_t{0}}) {
    for (const double sign : {1.0, -1.0}) {
      const double stands = Standing(mesh, bounds, axis, sign > 0);
      const bool usual = sign > 0 && axis != 0;
      if (stands <= most * kBetter || (!usual && stands < kBase)) continue;
      most = stands;
      best = Axis(axis, sign);
    }
  }
  return best;
}

}  // namespace mtdb
