// SPDX-License-Identifier: Apache-2.0
// Parts of triangles and the volumes above them, against sums over many small ones.
#include "query/terrain/overlay.h"

#include <catch2/catch.hpp>
#include <random>

#include "query/terrain/linear_integral.h"

namespace mtdb::test {
namespace {

using namespace internal;

TEST_CASE("what is positive of a linear function is integrated exactly") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int round = 0; round < 60; ++round) {
    const std::array<double, 3> f{unit(random), unit(random), unit(random)};
    const double area = 1 + unit(random) / 2;
    // Small triangles, by their middles.
    constexpr int kSteps = 400;
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) {
      for (int j = 0; i + j < kSteps; ++j) {
        for (const double third : {1.0 / 3, 2.0 / 3}) {
          const double u = (i + third) / kSteps, v = (j + third) / kSteps;
          if (u + v > 1) continue;
          sum += std::max(0.0, f[0] + u * (f[1] - f[0]) + v * (f[2] - f[0]));
        }
      }
    }
    CHECK(PositivePart(f, area) == Approx(sum * area / (kSteps * kSteps)).margin(1e-4));
    // Both signs together are the whole.
    const double minus = PositivePart({-f[0], -f[1], -f[2]}, area);
    CHECK(PositivePart(f, area) - minus == Approx(area * (f[0] + f[1] + f[2]) / 3).margin(1e-14));
  }
  CHECK(PositivePart({0, 0, 0}, 1) == 0);
  CHECK(PositivePart({-1, 0, 0}, 1) == 0);
  CHECK(PositivePart({0, 0, 3}, 1) == Approx(1));
}

TEST_CASE("common parts of triangles and rectangles have the area that random places find") {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(0, 1);
  const auto triangle = [&] {
    const auto point = [&] { return Vec3d{unit(random), unit(random), 0}; };
    return Triangle3d{point(), point(), point()};
  };
  for (int round = 0; round < 40; ++round) {
    const Triangle3d a = triangle(), b = triangle();
    const PlaneWindow window{0.3 * unit(random), 0.3 * unit(random), 0.5 + 0.5 * unit(random),
                             0.5 + 0.5 * unit(random)};
    PlanePolygon part{PlaneTriangle(a)};
    part.ClipTo(window);
    if (!part.empty()) part.ClipTo(PlaneTriangle(b));
    const auto inside = [](const Triangle3d& t, double x, double y) {
      int left = 0, right = 0;
      for (size_t i = 0; i < 3; ++i) {
        const Vec3d p = t[i], q = t[(i + 1) % 3];
        ((q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x) > 0 ? left : right) += 1;
      }
      return left == 3 || right == 3;
    };
    int hits = 0;
    constexpr int kTries = 40000;
    for (int i = 0; i < kTries; ++i) {
      const double x = unit(random), y = unit(random);
      hits += x > window.min_x && x < window.max_x && y > window.min_y && y < window.max_y &&
                      inside(a, x, y) && inside(b, x, y)
                  ? 1
                  : 0;
    }
    const double area = part.empty() ? 0 : part.area();
    CHECK(area == Approx(static_cast<double>(hits) / kTries).margin(0.02));
  }
}

TEST_CASE("heights in a triangle are those of its corners and between them") {
  const PlaneTriangle t({Vec3d{0, 0, 1}, Vec3d{0, 2, 5}, Vec3d{4, 0, 3}});
  CHECK(t.HeightAt(0, 0) == 1);
  CHECK(t.HeightAt(4, 0) == 3);
  CHECK(t.HeightAt(0, 2) == 5);
  CHECK(t.HeightAt(2, 0) == Approx(2));
  CHECK(t.HeightAt(1, 0.5) == Approx(2.5));
  CHECK(t.HeightAt(9, 9) <= 5);
  CHECK(t.HeightSlack(1e-3) > 2e-3);
  CHECK(t.HeightSlack(1e9) == 4);
  const PlaneTriangle none({Vec3d{1, 1, 1}, Vec3d{2, 2, 2}, Vec3d{3, 3, 5}});
  CHECK(none.HeightSlack(1e-9) <= 4);
}

}  // namespace
}  // namespace mtdb::test
