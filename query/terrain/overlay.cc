// SPDX-License-Identifier: Apache-2.0
#include "query/terrain/overlay.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace mtdb::internal {
namespace {

// Twice the area of abp; above 0 where p is to the left of ab.
double Twice(Vec3d a, Vec3d b, double x, double y) {
  return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
}

Triangle3d CounterClockwise(Triangle3d t) {
  if (Twice(t[0], t[1], t[2].x, t[2].y) < 0) std::swap(t[1], t[2]);
  return t;
}

}  // namespace

PlaneTriangle::PlaneTriangle(const Triangle3d& t) : corners_(CounterClockwise(t)) {
  const auto [least, most] = std::minmax({t[0].z, t[1].z, t[2].z});
  range_ = most - least;
  const Vec3d normal = Cross(corners_[1] - corners_[0], corners_[2] - corners_[0]);
  slope_ = std::hypot(normal.x, normal.y) / std::abs(normal.z);
}

double PlaneTriangle::HeightAt(double x, double y) const {
  std::array<double, 3> weight{};
  double sum = 0;
  for (size_t i = 0; i < 3; ++i) {
    weight[i] = std::max(0.0, Twice(corners_[(i + 1) % 3], corners_[(i + 2) % 3], x, y));
    sum += weight[i];
  }
  if (!(sum > 0)) return corners_[0].z;
  double height = 0;
  for (size_t i = 0; i < 3; ++i) height += weight[i] / sum * (corners_[i].z - corners_[0].z);
  return corners_[0].z + height;
}

double PlaneTriangle::HeightSlack(double moved) const {
  const double slack = slope_ * moved;
  return slack < range_ ? slack : range_;  // NaN of a triangle without an area, too
}

PlanePolygon::PlanePolygon(const PlaneTriangle& t) : size_(3) {
  std::ranges::copy(t.corners(), corners_.begin());
}

double PlanePolygon::area() const {
  double twice = 0;
  for (size_t i = 2; i < size_; ++i) {
    twice += Twice(corners_[0], corners_[i - 1], corners_[i].x, corners_[i].y);
  }
  return std::max(0.0, twice / 2);
}

template <typename Side>
void PlanePolygon::Clip(const Side& side) {
  std::array<double, kMost> at{};
  size_t outside = 0;
  for (size_t i = 0; i < size_; ++i) {
    at[i] = side(corners_[i]);
    outside += at[i] < 0 ? 1 : 0;
  }
  if (outside == 0) return;
  if (outside == size_) {
    size_ = 0;
    return;
  }
  std::array<Vec3d, kMost> kept;
  size_t size = 0;
  for (size_t i = 0; i < size_; ++i) {
    const size_t next = i + 1 == size_ ? 0 : i + 1;
    const Vec3d a = corners_[i], b = corners_[next];
    if (at[i] >= 0 && size < kMost) kept[size++] = a;
    if ((at[i] < 0) != (at[next] < 0) && size < kMost) {
      kept[size++] = a + (b - a) * (at[i] / (at[i] - at[next]));
    }
  }
  std::copy_n(kept.begin(), size, corners_.begin());
  size_ = size;
}

void PlanePolygon::ClipTo(const PlaneWindow& window) {
  const auto outside = [&](Vec3d p) {
    return p.x < window.min_x || p.x > window.max_x || p.y < window.min_y || p.y > window.max_y;
  };
  if (std::ranges::none_of(corners(), outside)) return;
  Clip([&](Vec3d p) { return p.x - window.min_x; });
  Clip([&](Vec3d p) { return window.max_x - p.x; });
  Clip([&](Vec3d p) { return p.y - window.min_y; });
  Clip([&](Vec3d p) { return window.max_y - p.y; });
}

void PlanePolygon::ClipTo(const PlaneTriangle& triangle) {
  const Triangle3d& t = triangle.corners();
  for (size_t i = 0; i < 3 && !empty(); ++i) {
    Clip([&](Vec3d p) { return Twice(t[i], t[(i + 1) % 3], p.x, p.y); });
  }
}

}  // namespace mtdb::internal
