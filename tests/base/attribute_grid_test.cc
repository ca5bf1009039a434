// SPDX-License-Identifier: Apache-2.0
#include "store/base/attribute_grid.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>

namespace mtdb {
namespace {

double Angle(const Vec3d& a, const Vec3d& b) {
  const Vec3d c = Cross(a, b);
  return std::atan2(Length(c), Dot(a, b));
}

// Where two points of the square's border are one of the octahedron, the one that codes use.
bool HasCode(int32_t s, int32_t t, int32_t centre) {
  return (std::abs(t) != centre || s >= 0) && (std::abs(s) != centre || t >= 0);
}

TEST_CASE("a decoded normal has its code, and float32 coordinates of length 1", "[base]") {
  for (const int bits : {4, 5, 7, 9, 16}) {
    const int32_t centre = OctahedralCentre(bits);
    const int32_t stride = bits > 9 ? 97 : 1;
    for (int32_t s = -centre; s <= centre; s += stride) {
      for (int32_t t = -centre; t <= centre; t += stride) {
        if (!HasCode(s, t, centre)) continue;
        const Vec3d normal = DecodeOctahedral({s, t}, bits);
        const OctahedralCode again = EncodeOctahedral(normal, bits);
        if (again.s != s || again.t != t) FAIL("bits " << bits << ", code " << s << " " << t);
        if (std::abs(Length(normal) - 1) > 1e-6) FAIL("length " << Length(normal));
        if (normal.x != static_cast<double>(static_cast<float>(normal.x))) FAIL("not a float32");
      }
    }
  }
}

TEST_CASE("a normal's direction is off by no more than is promised", "[base]") {
  std::mt19937_64 random(1);
  std::normal_distribution<double> coordinate;
  for (const int bits : {4, 8, 10, 12, 16}) {
    const double bound = 2.13 / OctahedralCentre(bits);
    double worst = 0;
    for (int i = 0; i < 20000; ++i) {
      Vec3d normal{coordinate(random), coordinate(random), coordinate(random)};
      if (i % 5 == 0) normal[i % 3] = 0;
      if (i % 7 == 0) normal[(i / 3) % 3] *= 1e-9;
      const OctahedralCode code = EncodeOctahedral(normal, bits);
      REQUIRE(HasCode(code.s, code.t, OctahedralCentre(bits)));
      worst = std::max(worst, Angle(normal, DecodeOctahedral(code, bits)));
    }
    CHECK(worst <= bound);
    CHECK(worst > 0.5 * bound);
  }
}

TEST_CASE("a normal without a direction points up", "[base]") {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const Vec3d& none : {Vec3d{0, 0, 0}, Vec3d{kInfinity, 0, 0}, Vec3d{0, std::nan(""), 1}}) {
    const Vec3d normal = DecodeOctahedral(EncodeOctahedral(none, 10), 10);
    CHECK((normal.x == 0 && normal.y == 0 && normal.z == 1));
  }
}

TEST_CASE("a value on the grid of steps has its code, whatever the step", "[base]") {
  std::mt19937_64 random(2);
  for (const double step : {1.0, 0.1, 1e-30, 3e20, 0.037}) {
    for (int i = 0; i < 20000; ++i) {
      const auto any = static_cast<int64_t>(random());
      const int64_t small = any % (MaxScalarCode(ScalarType::kFloat32) + 1);
      REQUIRE(ScalarCode(Float32OfCode(small, step), step) == small);
      const int64_t large = any % (MaxScalarCode(ScalarType::kFloat64) + 1);
      REQUIRE(ScalarCode(Float64OfCode(large, step), step) == large);
      const double value = 1e-3 * step * static_cast<double>(any % 1000000);
      const double rounded = Float64OfCode(ScalarCode(value, step), step);
      REQUIRE(std::abs(rounded - value) <= 0.5000001 * step);
    }
  }
  CHECK(ScalarCode(std::nan(""), 1) == 0);
  CHECK(ScalarCode(1e300, 1e-10) == 0);
  CHECK(Float32OfCode(int64_t{1} << 50, 1e30) == 0);
  CHECK(Float64OfCode(int64_t{1} << 50, 1e300) == 0);
}

TEST_CASE("a layout promises steps of floats and normals of three float32", "[base]") {
  const VertexAttribute plain{"n", ScalarType::kFloat32};
  VertexAttribute normal = plain;
  normal.normal_bits = 10;
  VertexAttribute step = plain;
  step.step = 0.5;
  VertexAttribute integer{"i", ScalarType::kInt32};
  CHECK(IsValidLayout({}));
  CHECK(IsValidLayout({{integer, normal, plain, plain, step}}));
  CHECK_FALSE(IsValidLayout({{normal, plain}}));
  CHECK_FALSE(IsValidLayout({{normal, plain, step}}));
  CHECK_FALSE(IsValidLayout({{normal, plain, integer}}));
  CHECK_FALSE(IsValidLayout({{normal, normal, plain, plain}}));
  normal.normal_bits = 17;
  CHECK_FALSE(IsValidLayout({{normal, plain, plain}}));
  normal.normal_bits = 3;
  CHECK_FALSE(IsValidLayout({{normal, plain, plain}}));
  step.step = -1;
  CHECK_FALSE(IsValidLayout({{step}}));
  step.step = std::nan("");
  CHECK_FALSE(IsValidLayout({{step}}));
  integer.step = 1;
  CHECK_FALSE(IsValidLayout({{integer}}));
}

}  // namespace
}  // namespace mtdb
