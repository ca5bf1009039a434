// SPDX-License-Identifier: Apache-2.0
// To which multiples the heights of floats are rounded when nobody says it.
#include "codecs/raster_file/height_step.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "tests/support/memory_raster.h"

namespace mtdb {
namespace {

constexpr uint32_t kColumns = 40, kRows = 30;
using Heights = std::vector<double>;

Heights Hills(double height, double noise, uint64_t seed = 1) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> off(-noise, noise);
  Heights heights;
  for (uint32_t r = 0; r < kRows; ++r) {
    for (uint32_t c = 0; c < kColumns; ++c) {
      heights.push_back(height * (std::sin(0.1 * c) + std::cos(0.13 * r)) + off(random));
    }
  }
  return heights;
}

Heights Mapped(Heights heights, const std::function<double(double)>& change) {
  for (double& h : heights) h = change(h);
  return heights;
}

HeightStep Chosen(const Heights& heights) {
  RasterMosaic mosaic =
      testing::MosaicOf(std::make_unique<testing::MemoryRaster>(kColumns, kRows, heights));
  const Result<HeightStep> step = ChooseHeightStep(mosaic);
  REQUIRE(step.ok());
  return *step;
}

// The promises, held against all pairs of neighbours.
void CheckPromise(const Heights& heights, const HeightStep& chosen) {
  double least = 1e300, most = -1e300, sum = 0, rounding = 0;
  size_t count = 0;
  for (size_t i = 0; i < heights.size(); ++i) {
    const double h = heights[i];
    if (std::isnan(h)) continue;
    least = std::min(least, h);
    most = std::max(most, h);
    const double steps = std::floor((h - chosen.origin) / chosen.step + 0.5);
    rounding = std::max(rounding, std::abs(chosen.origin + chosen.step * steps - h));
    for (const size_t k : {i + 1, i + kColumns}) {
      if (k >= heights.size() || (k == i + 1 && k % kColumns == 0)) continue;
      const double difference = std::abs(heights[k] - h);
      if (!(difference > 0)) continue;
      sum += difference;
      ++count;
    }
  }
  CHECK(rounding <= 1.0001e-3 * (most - least));
  CHECK(rounding <= 1.0001e-2 * sum / static_cast<double>(count));
  // Not finer than it must be, but for the median and round numbers.
  CHECK(chosen.step > 1e-4 * std::min((most - least) / 500, sum / static_cast<double>(count) / 50));
}

TEST_CASE("floats that are decimals stay as they are written") {
  for (const double unit : {1.0, 0.1, 0.01, 0.001}) {
    for (const bool single : {true, false}) {
      CAPTURE(unit, single);
      const double power = std::round(1 / unit);
      const Heights heights = Mapped(Hills(200, 30), [&](double h) {
        const double decimal = std::round(h * power) / power;
        return single ? static_cast<double>(static_cast<float>(decimal)) : decimal;
      });
      const HeightStep chosen = Chosen(heights);
      CHECK(chosen.decimals);
      CHECK(chosen.step == Approx(unit).epsilon(1e-12));
      CHECK(chosen.origin == 0);
    }
  }
}

TEST_CASE("other floats are rounded so that it is small beside range and differences") {
  for (const double height : {1e-3, 1.0, 300.0, 8e3}) {
    for (const double noise : {1e-6, 1e-3, 0.1, 1.0}) {
      for (const bool single : {true, false}) {
        CAPTURE(height, noise, single);
        const Heights heights = Mapped(Hills(height, height * noise), [&](double h) {
          return single ? static_cast<double>(static_cast<float>(h)) : h;
        });
        const HeightStep chosen = Chosen(heights);
        CHECK(!chosen.decimals);
        CheckPromise(heights, chosen);
      }
    }
  }
}

TEST_CASE("holes, plains, far origins and one wrong height do not spoil the step") {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Heights holes = Hills(100, 0.1);
  for (size_t i = 0; i < holes.size(); i += 3) holes[i] = nan;
  CheckPromise(holes, Chosen(holes));
  const HeightStep plain = Chosen(Heights(kColumns * kRows, std::numbers::pi));
  CHECK(plain.step > 0);
  CHECK(plain.step < 1e-5);
  // A hole that the file does not mark.
  Heights wrong = Hills(100, 0.1);
  const double right = Chosen(wrong).step;
  wrong[77] = -3.4028234663852886e38;
  CHECK(Chosen(wrong).step <= right * 10);
  // Differences of a micrometre at 4000 m: counted from the least height.
  const Heights far = Mapped(Hills(1e-6, 0), [](double h) { return 4000 + h; });
  const HeightStep chosen = Chosen(far);
  CHECK(chosen.origin >= 3999.9);
  CheckPromise(far, chosen);
}

TEST_CASE("a raster without heights has no step") {
  RasterMosaic mosaic =
      testing::MosaicOf(std::make_unique<testing::MemoryRaster>(2, 2, Heights(4, testing::kHole)));
  CHECK(ChooseHeightStep(mosaic).status().code() == StatusCode::kBadInput);
}

}  // namespace
}  // namespace mtdb
