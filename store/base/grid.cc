// SPDX-License-Identifier: Apache-2.0
#include "store/base/grid.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace mtdb {

int32_t OrderedFromFloat(float f) {
  const auto bits = std::bit_cast<int32_t>(f);
  return bits >= 0 ? bits : static_cast<int32_t>(static_cast<uint32_t>(bits) ^ 0x7fffffffu);
}

Vec3i Grid::Quantize(Vec3d p) const {
  if (mode == PositionMode::kLossless) {
    return {OrderedFromFloat(static_cast<float>(p.x)), OrderedFromFloat(static_cast<float>(p.y)),
            OrderedFromFloat(static_cast<float>(p.z))};
  }
  const auto round = [&](double v, double o) {
    constexpr double kLeast = std::numeric_limits<int32_t>::min();
    constexpr double kMost = std::numeric_limits<int32_t>::max();
    return static_cast<int32_t>(std::clamp(std::floor((v - o) / step + 0.5), kLeast, kMost));
  };
  if (mode == PositionMode::kRaster) {
    const double determinant = plane[0] * plane[3] - plane[1] * plane[2];
    const double x = p.x - origin.x;
    const double y = p.y - origin.y;
    const auto nearest = [](double v) {
      constexpr double kMost = std::numeric_limits<int32_t>::max();
      return static_cast<int32_t>(std::clamp(std::floor(v + 0.5), -kMost, kMost));
    };
    return {nearest((x * plane[3] - y * plane[1]) / determinant),
            nearest((y * plane[0] - x * plane[2]) / determinant), round(p.z, origin.z)};
  }
  return {round(p.x, origin.x), round(p.y, origin.y), round(p.z, origin.z)};
}

Box3d Grid::Bounds(const Box3i& box) const {
  Box3d bounds{Position(box.min), Position(box.max)};
  if (mode == PositionMode::kRaster && !box.empty()) {
    bounds = {};
    for (const int32_t x : {box.min.x, box.max.x}) {
      for (const int32_t y : {box.min.y, box.max.y}) {
        for (const int32_t z : {box.min.z, box.max.z}) bounds.Add(Position({x, y, z}));
      }
    }
  }
  return bounds;
}

namespace {

// What origin + step * i, in double, is off by (Dekker; Knuth).
double ArithmeticError(double origin, double step, double i) {
  const double product = step * i;
  const double of_product = std::fma(step, i, -product);
  const double sum = origin + product;
  const double added = sum - origin;
  const double of_sum = (origin - (sum - added)) + (product - added);
  return of_product + of_sum;
}

}  // namespace

double Grid::Displacement(Vec3d p) const {
  const Vec3i i = Quantize(p);
  const double distance = Length(Position(i) - p);
  if (mode != PositionMode::kGrid) return distance;
  const double arithmetic =
      Length({ArithmeticError(origin.x, step, i.x), ArithmeticError(origin.y, step, i.y),
              ArithmeticError(origin.z, step, i.z)});
  // Errors are those of the exact grid: on the way there and back.
  return (distance + 2 * arithmetic) * (1 + 1e-12);
}

// Multiples of a power of two, and not too many.
bool Grid::FitsFloat(const Box3d& bounds) const {
  if (mode == PositionMode::kLossless) return true;
  if (mode == PositionMode::kRaster) return false;
  constexpr double kLargest = 1 << 24;
  int exponent = 0;
  if (std::frexp(step, &exponent) != 0.5 || step < 0x1p-149 || step > 0x1p100) return false;
  for (int i = 0; i < 3; ++i) {
    const double from = origin[i] / step;
    if (from != std::floor(from) || std::abs(from) > 0x1p52) return false;
    if (std::abs(bounds.min[i]) > kLargest * step || std::abs(bounds.max[i]) > kLargest * step) {
      return false;
    }
  }
  return true;
}

double Grid::cell_error() const {
  if (mode == PositionMode::kRaster) return step * 0.5000001;
  return mode == PositionMode::kLossless ? 0.0 : step * 0.8660254037844387 * 1.000001;
}

double Grid::Error(uint8_t code) const {
  // 2^(i/8)
  static constexpr double kEighths[kErrorStepsPerOctave] = {1.0,
                                                            1.0905077326652577,
                                                            1.189207115002721,
                                                            1.2968395546510096,
                                                            1.4142135623730951,
                                                            1.5422108254079407,
                                                            1.681792830507429,
                                                            1.8340080864093424};
  if (code == 0) return 0;
  const int c = code - 1;
  return std::ldexp(error_unit * kEighths[c % kErrorStepsPerOctave], c / kErrorStepsPerOctave);
}

uint8_t Grid::ErrorCode(double error) const {
  if (!(error > 0)) return 0;
  uint8_t low = 0;  // Error(low) < error
  uint8_t high = 255;
  while (high - low > 1) {
    const auto middle = static_cast<uint8_t>((low + high) / 2);
    (Error(middle) < error ? low : high) = middle;
  }
  return high;
}

}  // namespace mtdb
