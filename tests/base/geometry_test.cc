// SPDX-License-Identifier: Apache-2.0
// Distances against dense sampling: a sample is a true point of the object, so that no sample may
// be nearer than the answer, and the nearest sample is not much farther.
#include "store/base/geometry.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace mtdb {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

class Random {
 public:
  explicit Random(uint64_t seed) : engine_(seed) {}
  double Real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  // Small integers now and then: they make touching, flat and parallel things likely.
  double Coordinate() {
    return engine_() % 3 == 0 ? static_cast<double>(static_cast<int>(engine_() % 5) - 2)
                              : Real(-2, 2);
  }
  Vec3d Point() { return {Coordinate(), Coordinate(), Coordinate()}; }
  Box3d Box() {
    Box3d box;
    box.Add(Point());
    box.Add(Point());
    return box;
  }
  // Among them degenerate ones and needles.
  Triangle3d Triangle() {
    Triangle3d t = {Point(), Point(), Point()};
    switch (engine_() % 8) {
      case 0: t[2] = t[0]; break;
      case 1: t[2] = (t[0] + t[1]) * 0.5; break;
      case 2: t[2] = t[1] + Point() * 1e-9; break;
      case 3: t = {t[0], t[0], t[0]}; break;
      default: break;
    }
    return t;
  }

 private:
  std::mt19937_64 engine_;
};

Vec3d Clamp(Vec3d p, const Box3d& box) {
  return {std::clamp(p.x, box.min.x, box.max.x), std::clamp(p.y, box.min.y, box.max.y),
          std::clamp(p.z, box.min.z, box.max.z)};
}

constexpr int kSamples = 60;  // along an edge

std::vector<Vec3d> SampleTriangle(const Triangle3d& t) {
  std::vector<Vec3d> samples;
  for (int i = 0; i <= kSamples; ++i) {
    for (int j = 0; i + j <= kSamples; ++j) {
      const double b = static_cast<double>(i) / kSamples;
      const double c = static_cast<double>(j) / kSamples;
      samples.push_back(t[0] * (1 - b - c) + t[1] * b + t[2] * c);
    }
  }
  return samples;
}

// No point of the triangle is farther from a sample than this.
double SampleSpacing(const Triangle3d& t) {
  return std::max({Length(t[1] - t[0]), Length(t[2] - t[1]), Length(t[0] - t[2])}) / kSamples;
}

void RequireNearest(double squared_answer, double nearest_sample, double spacing) {
  const double answer = std::sqrt(squared_answer);
  REQUIRE(answer <= nearest_sample + 1e-9);
  REQUIRE(answer >= nearest_sample - spacing - 1e-9);
}

TEST_CASE("Vectors and boxes do what their names say") {
  const Vec3d a{1, 2, 3}, b{4, 5, 6.5};
  REQUIRE(Dot(a, b) == 33.5);
  REQUIRE(Cross(Vec3d{1, 0, 0}, Vec3d{0, 1, 0}) == Vec3d{0, 0, 1});
  REQUIRE(Length(Vec3d{2, 3, 6}) == 7);
  Box3d box;
  REQUIRE(box.empty());
  REQUIRE(Diagonal(box) == 0);
  box.Add(Box3d{});
  REQUIRE(box.empty());
  box.Add(a);
  REQUIRE_FALSE(box.empty());
  box.Add(b);
  REQUIRE(box.Contains(a));
  REQUIRE(box.Contains({4, 5, 6.5}));
  REQUIRE_FALSE(box.Contains({4, 5, 6.6}));
  REQUIRE(Diagonal(box) == Length(b - a));
}

TEST_CASE("The distance from a point to a box is to the clamped point") {
  Random random(1);
  for (int i = 0; i < 2000; ++i) {
    const Box3d box = random.Box();
    const Vec3d p = random.Point() * 2;
    REQUIRE(SquaredDistancePointBox(p, box) ==
            Approx(SquaredLength(p - Clamp(p, box))).margin(1e-12));
    REQUIRE((SquaredDistancePointBox(p, box) == 0) == box.Contains(p));
  }
}

TEST_CASE("The distance between boxes is symmetric and that of their nearest points") {
  Random random(2);
  for (int i = 0; i < 2000; ++i) {
    const Box3d a = random.Box();
    Box3d b = random.Box();
    const Vec3d shift = random.Point();
    b.min += shift;
    b.max += shift;
    // Alternating projections end at nearest points of two boxes.
    Vec3d p = a.min;
    Vec3d q = Clamp(p, b);
    for (int round = 0; round < 4; ++round) {
      p = Clamp(q, a);
      q = Clamp(p, b);
    }
    REQUIRE(SquaredDistanceBoxBox(a, b) == Approx(SquaredLength(p - q)).margin(1e-12));
    REQUIRE(SquaredDistanceBoxBox(a, b) == SquaredDistanceBoxBox(b, a));
  }
}

TEST_CASE("Distances of segments agree with dense sampling, degenerate ones too") {
  Random random(3);
  constexpr int kSteps = 80;
  for (int i = 0; i < 1500; ++i) {
    const Vec3d a = random.Point(), b = i % 7 == 0 ? a : random.Point();
    const Vec3d c = random.Point();
    // Points, and parallels exact and nearly so, among the others.
    const Vec3d d = i % 5 == 0   ? c
                    : i % 5 == 1 ? c + (b - a) * 0.5
                    : i % 5 == 2 ? c + (b - a) + random.Point() * 1e-10
                                 : random.Point();
    double nearest = kInfinity, nearest_to_c = kInfinity;
    for (int s = 0; s <= kSteps; ++s) {
      const Vec3d p = a + (b - a) * (static_cast<double>(s) / kSteps);
      nearest = std::min(nearest, std::sqrt(SquaredDistancePointSegment(p, c, d)));
      nearest_to_c = std::min(nearest_to_c, Length(p - c));
    }
    const double spacing = Length(b - a) / kSteps;
    CAPTURE(i);
    RequireNearest(SquaredDistancePointSegment(c, a, b), nearest_to_c, spacing);
    RequireNearest(SquaredDistanceSegmentSegment(a, b, c, d), nearest, spacing);
    RequireNearest(SquaredDistanceSegmentSegment(c, d, b, a), nearest, spacing);
  }
}

TEST_CASE("Segments that cross at a tiny angle are as near as they are") {
  Random random(14);
  for (int k = 0; k < 2000; ++k) {
    const Vec3d along = random.Point() + Vec3d{0, 0, 3.5};
    const Vec3d aside = Cross(along, random.Point() + Vec3d{3.5, 0, 0});
    const double angle = std::pow(10, random.Real(-10, 0));
    const Vec3d other = along + aside * (angle / Length(aside));
    const Vec3d crossing = random.Point();
    const double d2 = SquaredDistanceSegmentSegment(
        crossing - along * random.Real(0, 1), crossing + along * random.Real(0, 1),
        crossing - other * random.Real(0, 1), crossing + other * random.Real(0, 1));
    REQUIRE(std::sqrt(d2) < 1e-14);
  }
}

TEST_CASE("The distance from a segment to a triangle agrees with dense sampling") {
  Random random(15);
  int crossing = 0;
  for (int k = 0; k < 1000; ++k) {
    const Triangle3d t = random.Triangle();
    const Vec3d p = random.Point();
    const Vec3d q = k % 10 == 0 ? p : random.Point();
    const double d2 = SquaredDistanceSegmentTriangle(p, q, t);
    double nearest = kInfinity;
    for (const Vec3d& s : SampleTriangle(t)) {
      nearest = std::min(nearest, std::sqrt(SquaredDistancePointSegment(s, p, q)));
    }
    RequireNearest(d2, nearest, SampleSpacing(t));
    // Through the triangle's inside. Needles of this test are 4e-9 wide.
    const Vec3d normal = Cross(t[1] - t[0], t[2] - t[0]);
    const double rounding = Length(normal) > 1e-4 ? 1e-13 : 4e-9;
    const Vec3d inside = t[0] * 0.2 + t[1] * 0.3 + t[2] * 0.5;
    REQUIRE(std::sqrt(SquaredDistanceSegmentTriangle(p, inside + inside - p, t)) < rounding);
    crossing += d2 < 1e-28;
  }
  REQUIRE(crossing > 20);
}

TEST_CASE("The distance from a point to a triangle agrees with dense sampling") {
  Random random(4);
  for (int i = 0; i < 1500; ++i) {
    const Triangle3d t = random.Triangle();
    const Vec3d p = i % 4 == 0 ? t[i % 3] : random.Point();
    double nearest = kInfinity;
    for (const Vec3d& s : SampleTriangle(t)) nearest = std::min(nearest, Length(p - s));
    CAPTURE(i);
    RequireNearest(SquaredDistancePointTriangle(p, t[0], t[1], t[2]), nearest, SampleSpacing(t));
    RequireNearest(SquaredDistancePointTriangle(p, t[2], t[1], t[0]), nearest, SampleSpacing(t));
  }
}

TEST_CASE("The distance to a needle is right however thin it is") {
  Random random(5);
  for (int i = 0; i < 20000; ++i) {
    const Vec3d a = random.Point(), b = random.Point(), p = random.Point();
    const double width = std::pow(10.0, random.Real(-18, -3));
    const Vec3d c = a + (b - a) * random.Real(-0.5, 1.5) + random.Point() * width;
    // All of the needle is within 6 widths of its longest edge.
    const double needle = std::sqrt(SquaredDistancePointTriangle(p, a, b, c));
    const double edges = std::sqrt(
        std::min({SquaredDistancePointSegment(p, a, b), SquaredDistancePointSegment(p, b, c),
                  SquaredDistancePointSegment(p, c, a)}));
    CAPTURE(i, width, needle, edges);
    REQUIRE(needle <= edges + 1e-9);
    REQUIRE(needle >= edges - 6 * width - 1e-9);
  }
}

TEST_CASE("The distance from a triangle to a box agrees with dense sampling") {
  Random random(6);
  int meeting = 0, apart = 0;
  for (int i = 0; i < 3000; ++i) {
    const Triangle3d t = random.Triangle();
    Box3d box = random.Box();
    const Vec3d shift = random.Point() * (i % 3);
    box.min += shift;
    box.max += shift;
    double nearest = kInfinity;
    for (const Vec3d& s : SampleTriangle(t)) {
      nearest = std::min(nearest, std::sqrt(SquaredDistancePointBox(s, box)));
    }
    CAPTURE(i);
    const double squared = SquaredDistanceTriangleBox(t, box);
    RequireNearest(squared, nearest, SampleSpacing(t));
    const bool meets = TriangleMeetsBox(t, box);
    REQUIRE(meets == (squared == 0));
    if (nearest == 0) REQUIRE(meets);
    (meets ? meeting : apart) += 1;
  }
  REQUIRE(meeting > 300);
  REQUIRE(apart > 300);
}

TEST_CASE("A triangle that touches a box at a corner, an edge or a face meets it") {
  const Box3d box{{0, 0, 0}, {1, 1, 1}};
  REQUIRE(TriangleMeetsBox({{{1, 1, 1}, {2, 1, 1}, {1, 2, 2}}}, box));
  REQUIRE(TriangleMeetsBox({{{2, 0, 0.5}, {0, 2, 0.5}, {3, 3, 0.5}}}, box));
  REQUIRE(TriangleMeetsBox({{{-5, -5, 1}, {5, -5, 1}, {0, 9, 1}}}, box));
  REQUIRE(TriangleMeetsBox({{{-9, -9, 0.5}, {9, -9, 0.5}, {0, 9, 0.5}}}, box));
  REQUIRE(TriangleMeetsBox({{{0.4, 0.4, 0.4}, {0.5, 0.4, 0.4}, {0.4, 0.5, 0.4}}}, box));
  // Near a corner and an edge, within the box's bounds on every axis.
  REQUIRE_FALSE(TriangleMeetsBox({{{1.6, 0.5, 0.5}, {0.5, 1.6, 0.5}, {1.6, 1.6, 0.5}}}, box));
  REQUIRE_FALSE(TriangleMeetsBox({{{2.1, 0.5, 0.5}, {0.5, 2.1, 0.5}, {0.5, 0.5, 2.1}}}, box));
  REQUIRE(TriangleMeetsBox({{{1.9, 0.5, 0.5}, {0.5, 1.9, 0.5}, {0.5, 0.5, 1.9}}}, box));
  REQUIRE_FALSE(TriangleMeetsBox({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}, Box3d{}));
}

TEST_CASE("Boxes may be unbounded on any side") {
  Random random(7);
  for (int i = 0; i < 2000; ++i) {
    const Triangle3d t = random.Triangle();
    Box3d open = random.Box();
    const Vec3d shift = random.Point();
    open.min += shift;
    open.max += shift;
    Box3d large = open;
    for (int axis = 0; axis < 3; ++axis) {
      if ((i >> axis) & 1) {
        open.max[axis] = kInfinity;
        large.max[axis] = 100;
      }
      if ((i >> (3 + axis)) & 1) {
        open.min[axis] = -kInfinity;
        large.min[axis] = -100;
      }
    }
    CAPTURE(i);
    REQUIRE(TriangleMeetsBox(t, open) == TriangleMeetsBox(t, large));
    REQUIRE(SquaredDistanceTriangleBox(t, open) ==
            Approx(SquaredDistanceTriangleBox(t, large)).margin(1e-12));
  }
}

TEST_CASE("Distances keep their precision far from the origin of a large box") {
  Random random(8);
  for (int i = 0; i < 1000; ++i) {
    const Triangle3d t = random.Triangle();
    const Box3d small{{-3, -3, -3}, {3, 3, 1.0 + random.Real(0, 1)}};
    Box3d huge{{-1e17, -1e17, -1e17}, {1e17, 1e17, small.max.z}};
    CAPTURE(i);
    REQUIRE(TriangleMeetsBox(t, huge) == TriangleMeetsBox(t, small));
    REQUIRE(SquaredDistanceTriangleBox(t, huge) ==
            Approx(SquaredDistanceTriangleBox(t, small)).margin(1e-12));
  }
}

}  // namespace
}  // namespace mtdb
