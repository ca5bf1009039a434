// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/polygons/polygon_triangulator.h"

#include <algorithm>
#include <cmath>

#include "codecs/mesh_file/polygons/ear_cutter.h"
#include "codecs/mesh_file/polygons/exact_turn.h"
#include "store/base/check.h"

namespace mtdb::internal {
namespace {

constexpr double kLeastExact = 0x1p-400;  // see TurnOf

bool IsTiny(double value) { return value != 0 && std::abs(value) < kLeastExact; }

// Where coordinates are so small that products of them would be lost: the polygon as large as 1,
// with what is much smaller than that at 0.
std::span<const Vec3d> Scaled(std::span<const Vec3d> corners, std::vector<Vec3d>* scaled) {
  double largest = 0;
  bool tiny = false;
  for (const Vec3d& p : corners) {
    for (int axis = 0; axis < 3; ++axis) {
      largest = std::max(largest, std::abs(p[axis]));
      tiny |= IsTiny(p[axis]);
    }
  }
  if (!tiny) return corners;
  scaled->assign(corners.begin(), corners.end());
  const int power = -std::ilogb(largest);
  for (Vec3d& p : *scaled) {
    for (int axis = 0; axis < 3; ++axis) {
      p[axis] = std::ldexp(p[axis], power);
      if (IsTiny(p[axis])) p[axis] = 0;
    }
  }
  return *scaled;
}

// Twice the area that each plane of coordinates sees.
Vec3d NewellNormal(std::span<const Vec3d> corners) {
  Vec3d normal;
  for (size_t i = 2; i < corners.size(); ++i) {
    normal += Cross(corners[i - 1] - corners[0], corners[i] - corners[0]);
  }
  return normal;
}

// The axes, that along which the polygon shows most of its area first.
std::array<int, 3> AxesByArea(Vec3d normal) {
  std::array<int, 3> axes{2, 0, 1};
  std::ranges::stable_sort(axes, std::greater(), [&](int axis) { return std::abs(normal[axis]); });
  return axes;
}

PlanePoint SeenAlong(Vec3d p, int axis) {
  if (axis == 0) return {p.y, p.z};
  if (axis == 1) return {p.z, p.x};
  return {p.x, p.y};
}

std::vector<PlanePoint> PointsAlong(std::span<const Vec3d> corners, int axis) {
  std::vector<PlanePoint> points;
  for (const Vec3d& corner : corners) points.push_back(SeenAlong(corner, axis));
  return points;
}

bool IsOnLine(std::span<const PlanePoint> points) {
  const auto other = std::ranges::find_if(points, [&](PlanePoint p) { return p != points[0]; });
  return other == points.end() || std::ranges::all_of(points, [&](PlanePoint p) {
           return TurnOf(points[0], *other, p) == 0;
         });
}

// In space, not only as it is seen along an axis.
bool IsOnLine(std::span<const Vec3d> corners) {
  return IsOnLine(PointsAlong(corners, 0)) && IsOnLine(PointsAlong(corners, 1)) &&
         IsOnLine(PointsAlong(corners, 2));
}

}  // namespace

PolygonTriangulator::PolygonTriangulator() : cutter_(std::make_unique<EarCutter>()) {}
PolygonTriangulator::~PolygonTriangulator() = default;

std::span<const PolygonTriangulator::Triangle> PolygonTriangulator::Triangulate(
    std::span<const Vec3d> corners, bool* is_fan) {
  MTDB_CHECK(corners.size() >= 3 && corners.size() <= kMostCorners, "a polygon of legal size");
  *is_fan = false;
  triangles_.clear();
  if (corners.size() == 3) {
    triangles_.push_back({0, 1, 2});
    return triangles_;
  }
  corners = Scaled(corners, &scaled_);
  const Vec3d normal = NewellNormal(corners);
  // Another axis shows less of a polygon that is not planar, but maybe without crossings.
  constexpr double kMuchLess = 0.25;
  const std::array<int, 3> axes = AxesByArea(normal);
  const double most = std::abs(normal[axes[0]]);
  for (const int axis : axes) {
    if (std::abs(normal[axis]) < kMuchLess * most) break;
    if (TriangulateAlong(corners, axis, normal[axis] < 0)) return triangles_;
  }
  // Where the area is hardly any, its sign may be one of rounding.
  if (TriangulateAlong(corners, axes[0], normal[axes[0]] >= 0)) return triangles_;
  *is_fan = true;
  Fan(corners.size());
  return triangles_;
}

void PolygonTriangulator::Fan(size_t corners) {
  triangles_.clear();
  for (uint32_t i = 2; i < corners; ++i) triangles_.push_back({0, i - 1, i});
}

bool PolygonTriangulator::TriangulateAlong(std::span<const Vec3d> corners, int axis, bool turned) {
  points_.clear();
  for (const Vec3d& corner : corners) {
    const PlanePoint p = SeenAlong(corner, axis);
    points_.push_back(turned ? PlanePoint{p.y, p.x} : p);
  }
  if (corners.size() == 4) return SplitQuad(corners);
  if (SplitFan()) return true;
  if (IsOnLine(points_)) {
    if (!IsOnLine(corners)) return false;
    Fan(corners.size());
    return true;
  }
  return cutter_->Cut(points_, false, &triangles_) || cutter_->Cut(points_, true, &triangles_);
}

// Triangles that all turn left cover what the outline goes round, and nothing else.
bool PolygonTriangulator::SplitFan() {
  for (size_t i = 2; i < points_.size(); ++i) {
    if (TurnOf(points_[0], points_[i - 1], points_[i]) <= 0) return false;
  }
  Fan(points_.size());
  return true;
}

bool PolygonTriangulator::SplitQuad(std::span<const Vec3d> corners) {
  // Equal but for rounding counts as equal.
  constexpr double kClearly = 1 - 0x1p-20;
  const std::array<Triangle, 2> even{{{0, 1, 2}, {0, 2, 3}}}, odd{{{0, 1, 3}, {1, 2, 3}}};
  const auto fit = [&](const std::array<Triangle, 2>& pair) {
    int least = 1, most = -1;
    for (const Triangle& t : pair) {
      const int turn = TurnOf(points_[t[0]], points_[t[1]], points_[t[2]]);
      least = std::min(least, turn);
      most = std::max(most, turn);
    }
    return least > 0 ? 2 : least == 0 ? most : -1;  // 1 and 0: with triangles without area
  };
  const int even_fit = fit(even), odd_fit = fit(odd);
  const int better = std::max(even_fit, odd_fit);
  if (better < 0 || (better == 0 && !IsOnLine(corners))) return false;
  const bool shorter =
      SquaredLength(corners[3] - corners[1]) < kClearly * SquaredLength(corners[2] - corners[0]);
  const bool take_odd = odd_fit != even_fit ? odd_fit > even_fit : odd_fit == 2 && shorter;
  const auto& pair = take_odd ? odd : even;
  triangles_.assign(pair.begin(), pair.end());
  return true;
}

}  // namespace mtdb::internal
