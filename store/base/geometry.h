// SPDX-License-Identifier: Apache-2.0
// Points, boxes, and distances between them, in double and exact up to rounding. Nothing here takes
// memory.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace mtdb {

template <typename T>
struct Vec3 {
  T x{}, y{}, z{};

  constexpr T& operator[](int i) { return i == 0 ? x : i == 1 ? y : z; }
  constexpr const T& operator[](int i) const { return i == 0 ? x : i == 1 ? y : z; }
  friend constexpr Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend constexpr Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend constexpr Vec3 operator*(Vec3 a, T s) { return {a.x * s, a.y * s, a.z * s}; }
  friend constexpr Vec3 operator*(T s, Vec3 a) { return a * s; }
  Vec3& operator+=(Vec3 b) { return *this = *this + b; }
  Vec3& operator-=(Vec3 b) { return *this = *this - b; }
  friend constexpr bool operator==(Vec3, Vec3) = default;
  friend constexpr auto operator<=>(Vec3, Vec3) = default;
};

using Vec3d = Vec3<double>;
using Vec3f = Vec3<float>;
using Vec3i = Vec3<int32_t>;  // grid coordinates of an object

template <typename T>
constexpr T Dot(Vec3<T> a, Vec3<T> b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <typename T>
constexpr Vec3<T> Cross(Vec3<T> a, Vec3<T> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
template <typename T>
constexpr T SquaredLength(Vec3<T> a) {
  return Dot(a, a);
}
inline double Length(Vec3d a) { return std::sqrt(SquaredLength(a)); }
constexpr Vec3d ToDouble(Vec3i a) {
  return {static_cast<double>(a.x), static_cast<double>(a.y), static_cast<double>(a.z)};
}

using Triangle3d = std::array<Vec3d, 3>;

// An axis-aligned box; empty when min > max. Closed on all sides.
template <typename T>
struct Box3 {
  Vec3<T> min{std::numeric_limits<T>::max(), std::numeric_limits<T>::max(),
              std::numeric_limits<T>::max()};
  Vec3<T> max{std::numeric_limits<T>::lowest(), std::numeric_limits<T>::lowest(),
              std::numeric_limits<T>::lowest()};

  bool empty() const { return min.x > max.x || min.y > max.y || min.z > max.z; }
  void Add(Vec3<T> p) {
    min = {std::min(min.x, p.x), std::min(min.y, p.y), std::min(min.z, p.z)};
    max = {std::max(max.x, p.x), std::max(max.y, p.y), std::max(max.z, p.z)};
  }
  void Add(const Box3& b) {
    if (b.empty()) return;
    Add(b.min);
    Add(b.max);
  }
  bool Contains(Vec3<T> p) const {
    return p.x >= min.x && p.y >= min.y && p.z >= min.z && p.x <= max.x && p.y <= max.y &&
           p.z <= max.z;
  }
  friend bool operator==(const Box3&, const Box3&) = default;
};
using Box3d = Box3<double>;
using Box3i = Box3<int32_t>;

inline double Diagonal(const Box3d& b) { return b.empty() ? 0 : Length(b.max - b.min); }

// Squared distance from p to the box (0 inside).
double SquaredDistancePointBox(Vec3d p, const Box3d& box);
// Squared distance between two boxes (0 when they meet).
double SquaredDistanceBoxBox(const Box3d& a, const Box3d& b);
// Squared distance from p to the segment ab.
double SquaredDistancePointSegment(Vec3d p, Vec3d a, Vec3d b);
// Squared distance between the segments ab and cd.
double SquaredDistanceSegmentSegment(Vec3d a, Vec3d b, Vec3d c, Vec3d d);
// Squared distance from p to the (closed, possibly degenerate) triangle abc.
double SquaredDistancePointTriangle(Vec3d p, Vec3d a, Vec3d b, Vec3d c);
// Squared distance between the segment pq and the (possibly degenerate) triangle; where they cross,
// 0 up to rounding (in needles, up to their width).
double SquaredDistanceSegmentTriangle(Vec3d p, Vec3d q, const Triangle3d& t);
// Squared distance from the triangle to the box; 0 when they meet.
double SquaredDistanceTriangleBox(const Triangle3d& t, const Box3d& box);
// True when the triangle and the box have a common point (separating axes).
bool TriangleMeetsBox(const Triangle3d& t, const Box3d& box);

}  // namespace mtdb
