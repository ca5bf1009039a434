// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/filling_lanes.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace mtdb::internal {

namespace {
using Double2 = double __attribute__((vector_size(16)));
using Float2 = float __attribute__((vector_size(8)));

template <typename Vector>
struct Vec3Lanes {
  Vector x, y, z;

  friend Vec3Lanes operator-(const Vec3Lanes& a, const Vec3Lanes& b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
  }
  friend Vec3Lanes operator*(const Vec3Lanes& a, Vector f) { return {a.x * f, a.y * f, a.z * f}; }
  friend Vector Dot(const Vec3Lanes& a, const Vec3Lanes& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
  }
  friend Vec3Lanes Cross(const Vec3Lanes& a, const Vec3Lanes& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  }
};

// 0 for what is not above 0.
Double2 Inverse(Double2 a) { return a > 0 ? 1 / (a > 0 ? a : Double2{1, 1}) : Double2{}; }

// Height over length: rounding decides what lies over thinner triangles.
constexpr double kNeedle = 1.0 / 128;

Float4 Infinity4() { return Splat4(std::numeric_limits<float>::infinity()); }
}  // namespace

void SpreadPoints::Set(std::span<const Vec3d> points, double new_scale) {
  scale = new_scale;
  const size_t count = (points.size() + 3) / 4 * 4;
  for (auto* lane : {&x, &y, &z}) lane->resize(count);
  for (size_t p = 0; p < count; ++p) {
    const Vec3d point = points[std::min(p, points.size() - 1)] * scale;
    x[p] = static_cast<float>(point.x);
    y[p] = static_cast<float>(point.y);
    z[p] = static_cast<float>(point.z);
  }
}

// In binary64, two triangles at once; the last triangle again until four are full. Of a needle only
// the edges count, which are nowhere nearer than the triangle.
void FillingLanes::Set(const Hole& hole, const Hole::Triangles& triangles, double scale) {
  count_ = hole.k - 2;
  scale_ = scale;
  for (uint32_t t = 0; t < (count_ + 3) / 4 * 4; t += 2) {
    const auto put = [&](Number n, Double2 v) {
      const Float2 narrow = __builtin_convertvector(v, Float2);
      std::memcpy(&numbers_[n][t], &narrow, sizeof(narrow));
    };
    const auto put3 = [&](Number n, const Vec3Lanes<Double2>& v) {
      put(n, v.x);
      put(After(n, 1), v.y);
      put(After(n, 2), v.z);
    };
    const Hole::Triangle& one = triangles[std::min(t, count_ - 1)];
    const Hole::Triangle& two = triangles[std::min(t + 1, count_ - 1)];
    std::array<Vec3Lanes<Double2>, 3> corners;
    for (int c = 0; c < 3; ++c) {
      const Vec3d a = hole.points[one[c]] * scale;
      const Vec3d b = hole.points[two[c]] * scale;
      corners[c] = {Double2{a.x, b.x}, Double2{a.y, b.y}, Double2{a.z, b.z}};
    }
    const auto up = Cross(corners[1] - corners[0], corners[2] - corners[0]);
    const Double2 squared = Dot(up, up);
    const Double2 length{std::sqrt(squared[0]), std::sqrt(squared[1])};
    const auto normal = up * Inverse(length);
    put3(kNormal, normal);
    Double2 longest{};  // squared
    for (int c = 0; c < 3; ++c) {
      const auto along = corners[c == 2 ? 0 : c + 1] - corners[c];
      put3(After(kCorner, 3 * c), corners[c]);
      put3(After(kAlong, 3 * c), along);
      put3(After(kInwards, 3 * c), Cross(normal, along));
      const Double2 along2 = Dot(along, along);
      put(After(kPerLength2, c), Inverse(along2));
      longest = along2 > longest ? along2 : longest;
    }
    constexpr double kNowhere = std::numeric_limits<double>::infinity();
    put(kLeast, length > kNeedle * longest ? Double2{} : Double2{kNowhere, kNowhere});
  }
}

// `get` gives a number of four triangles, for one point, or of one triangle, for four points.
template <typename Get>
Float4 FillingLanes::SquaredDistance(const Get& get, Float4 x, Float4 y, Float4 z) {
  using Lanes = Vec3Lanes<Float4>;
  const auto get3 = [&](Number n) { return Lanes{get(n), get(After(n, 1)), get(After(n, 2))}; };
  const Lanes point{x, y, z};
  const Float4 least = get(kLeast);
  const Float4 height = Dot(point - get3(kCorner), get3(kNormal));
  Float4 nearest = Infinity4();
  Int4 over{-1, -1, -1, -1};
  for (int c = 0; c < 3; ++c) {
    const Lanes along = get3(After(kAlong, 3 * c));
    const Lanes p = point - get3(After(kCorner, 3 * c));
    const Float4 t = Dot(p, along) * get(After(kPerLength2, c));
    const Lanes off = p - along * Min4(Max4(t, Float4{}), Splat4(1));
    nearest = Min4(nearest, Dot(off, off));
    over &= Dot(p, get3(After(kInwards, 3 * c))) >= least;
  }
  return over ? height * height : nearest;
}

float FillingLanes::SquaredDistance(Vec3d point) const {
  const Float4 x = Splat4(static_cast<float>(point.x * scale_));
  const Float4 y = Splat4(static_cast<float>(point.y * scale_));
  const Float4 z = Splat4(static_cast<float>(point.z * scale_));
  Float4 least = Infinity4();
  for (uint32_t t = 0; t < count_; t += 4) {
    const auto four = [&](Number n) { return Load4<Float4>(&numbers_[n][t]); };
    least = Min4(least, SquaredDistance(four, x, y, z));
  }
  return std::min(std::min(least[0], least[1]), std::min(least[2], least[3]));
}

void FillingLanes::FindNearest(const SpreadPoints& points, std::vector<float>& squared,
                               std::vector<uint32_t>& nearest) const {
  squared.assign(points.size(), std::numeric_limits<float>::infinity());
  nearest.assign(points.size(), 0);
  for (uint32_t t = 0; t < count_; ++t) {
    const auto splat = [&](Number n) { return Splat4(numbers_[n][t]); };
    const Int4 number = Int4{} + static_cast<int32_t>(t);
    for (size_t p = 0; p < points.size(); p += 4) {
      const Float4 here = SquaredDistance(splat, Load4<Float4>(&points.x[p]),
                                          Load4<Float4>(&points.y[p]), Load4<Float4>(&points.z[p]));
      const Float4 before = Load4<Float4>(&squared[p]);
      Store4(&squared[p], Min4(here, before));
      Store4(&nearest[p], here < before ? number : Load4<Int4>(&nearest[p]));
    }
  }
}

}  // namespace mtdb::internal
