// SPDX-License-Identifier: Apache-2.0
#include "store/base/grid.h"

#include <algorithm>
#include <bit>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "store/base/raster_frame.h"

namespace mtdb {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

TEST_CASE("Ordered integers order as floats do, and come back as the same bits") {
  std::mt19937 random(1);
  std::vector<float> floats = {0.0f,
                               -0.0f,
                               1.0f,
                               -1.0f,
                               1e-45f,
                               -1e-45f,
                               3.4e38f,
                               -3.4e38f,
                               kInfinity,
                               -kInfinity,
                               std::numeric_limits<float>::min()};
  while (floats.size() < 5000) {
    const float f = std::bit_cast<float>(static_cast<uint32_t>(random()));
    if (!std::isnan(f)) floats.push_back(f);
  }
  for (const float f : floats) {
    const float back = FloatFromOrdered(OrderedFromFloat(f));
    REQUIRE(std::bit_cast<uint32_t>(back) == std::bit_cast<uint32_t>(f));
  }
  std::sort(floats.begin(), floats.end());
  for (size_t i = 1; i < floats.size(); ++i) {
    if (floats[i - 1] < floats[i]) {
      REQUIRE(OrderedFromFloat(floats[i - 1]) < OrderedFromFloat(floats[i]));
    }
  }
  REQUIRE(OrderedFromFloat(0.0f) == 0);
  REQUIRE(OrderedFromFloat(-0.0f) == -1);
}

TEST_CASE("Neighbouring floats have neighbouring ordered integers, over zero too") {
  for (const float f : {-2.0f, -1e-45f, 0.0f, 1.0f, 1e30f}) {
    REQUIRE(OrderedFromFloat(std::nextafter(f, kInfinity)) == OrderedFromFloat(f) + 1);
  }
}

TEST_CASE("A lossless grid gives back float32 positions bit for bit") {
  Grid grid;
  grid.mode = PositionMode::kLossless;
  for (const float f : {0.0f, -0.0f, 0.1f, -1e30f, 1e-40f}) {
    const Vec3d p = grid.Position(grid.Quantize({f, 1, -f}));
    REQUIRE(p == Vec3d{f, 1, -f});
    REQUIRE(std::signbit(p.x) == std::signbit(f));
  }
  REQUIRE(grid.cell_error() == 0);
}

TEST_CASE("A quantised position is within cell_error, and grid points are fixed points") {
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (const double step : {1e-6, 0.37, 1000.0}) {
    Grid grid;
    grid.origin = {-3.3, 1e3, 7};
    grid.step = step;
    for (int i = 0; i < 3000; ++i) {
      const Vec3d p = grid.origin + Vec3d{unit(random), unit(random), unit(random)} * (1e6 * step);
      const Vec3i q = grid.Quantize(p);
      const Vec3d back = grid.Position(q);
      REQUIRE(Length(back - p) <= grid.cell_error());
      REQUIRE(grid.Quantize(back) == q);
    }
    // The middle of a cell is the worst case, and it is reached.
    const Vec3d worst = grid.origin + Vec3d{0.5, 0.5, 0.5} * step;
    const double error = Length(grid.Position(grid.Quantize(worst)) - worst);
    REQUIRE(error <= grid.cell_error());
    REQUIRE(error >= 0.999 * grid.cell_error());
  }
}

TEST_CASE("Error codes grow by an eighth of an octave") {
  Grid grid;
  grid.error_unit = 0.003;
  REQUIRE(grid.Error(0) == 0);
  REQUIRE(grid.Error(1) == grid.error_unit);
  for (int c = 1; c < 255; ++c) {
    const double ratio =
        grid.Error(static_cast<uint8_t>(c + 1)) / grid.Error(static_cast<uint8_t>(c));
    REQUIRE(ratio == Approx(std::exp2(1.0 / kErrorStepsPerOctave)).epsilon(1e-12));
  }
  for (int c = 1; c + kErrorStepsPerOctave <= 255; ++c) {
    REQUIRE(grid.Error(static_cast<uint8_t>(c + kErrorStepsPerOctave)) ==
            2 * grid.Error(static_cast<uint8_t>(c)));
  }
}

TEST_CASE("ErrorCode is the smallest code whose error is at least the error") {
  for (const double error_unit : {1e-9, 0.003, 1.0, 5e4}) {
    Grid grid;
    grid.error_unit = error_unit;
    const auto smallest = [&](double error) {
      int c = 0;
      while (c < 255 && grid.Error(static_cast<uint8_t>(c)) < error) ++c;
      return c;
    };
    for (int c = 0; c <= 255; ++c) {
      const double error = grid.Error(static_cast<uint8_t>(c));
      REQUIRE(grid.ErrorCode(error) == c);
      const double more = std::nextafter(error, std::numeric_limits<double>::infinity());
      REQUIRE(grid.ErrorCode(more) == std::min(c + 1, 255));
      if (c > 0) REQUIRE(grid.ErrorCode(std::nextafter(error, 0.0)) == c);
    }
    std::mt19937_64 random(3);
    std::uniform_real_distribution<double> exponent(-4, 34);
    for (int i = 0; i < 2000; ++i) {
      const double error = error_unit * std::exp2(exponent(random));
      REQUIRE(grid.ErrorCode(error) == smallest(error));
    }
    REQUIRE(grid.ErrorCode(0) == 0);
    REQUIRE(grid.ErrorCode(std::numeric_limits<double>::denorm_min()) == 1);
    REQUIRE(grid.ErrorCode(std::numeric_limits<double>::infinity()) == 255);
  }
}

TEST_CASE("Points beyond the grid are drawn to its rim") {
  Grid grid;
  grid.step = 1e-3;
  constexpr int32_t kLeast = std::numeric_limits<int32_t>::min();
  constexpr int32_t kMost = std::numeric_limits<int32_t>::max();
  CHECK(grid.Quantize({1e12, -1e12, 0.002}) == Vec3i{kMost, kLeast, 2});
  CHECK(grid.Quantize({std::numeric_limits<double>::max(), std::numeric_limits<double>::lowest(),
                       grid.step * kMost}) == Vec3i{kMost, kLeast, kMost});
}

TEST_CASE("A raster's lattice is where its geotransform says, half a pixel from corners") {
  RasterFrame frame;
  frame.columns = 5;
  frame.rows = 4;
  frame.geotransform = {1000, 10, 0, 500, 0, -20};
  const Grid corners = GridOf(frame, 0.5, 100);
  CHECK(frame.is_flipped());
  CHECK(corners.Position({0, frame.LatticeRow(0), 2}) == Vec3d{1005, 490, 101});
  CHECK(corners.Position({4, frame.LatticeRow(3), 0}) == Vec3d{1045, 430, 100});
  frame.transform_of_samples = true;
  CHECK(GridOf(frame, 0.5, 100).Position({0, frame.LatticeRow(0), 2}) == Vec3d{1000, 500, 101});
  frame.geotransform = {1000, 10, 0, 500, 0, 20};  // rows run northwards
  CHECK_FALSE(frame.is_flipped());
  CHECK(GridOf(frame, 1, 0).Position({1, frame.LatticeRow(3), 7}) == Vec3d{1010, 560, 7});
  frame.geotransform = {7e5, 3, 4, 5e6, 4, -3};  // turned
  const Grid turned = GridOf(frame, 0.01, 0);
  Box3d bounds;
  Box3i box;
  for (int32_t column = 0; column < 5; ++column) {
    for (uint32_t row = 0; row < 4; ++row) {
      const Vec3i i{column, frame.LatticeRow(row), static_cast<int32_t>(row) - 2};
      const Vec3d p = turned.Position(i);
      CHECK(p.x == Approx(7e5 + 3 * column + 4 * row).epsilon(1e-14));
      CHECK(p.y == Approx(5e6 + 4 * column - 3.0 * row).epsilon(1e-14));
      CHECK(turned.Quantize(p) == i);
      CHECK(turned.Displacement(p) == 0);
      bounds.Add(p);
      box.Add(i);
    }
  }
  CHECK(turned.Bounds(box) == bounds);
}

}  // namespace
}  // namespace mtdb
