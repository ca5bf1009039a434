// SPDX-License-Identifier: Apache-2.0
// Grid: how an object's positions and errors become integers. One grid for a whole object.
#pragma once

#include <array>
#include <bit>
#include <cstdint>

#include "store/base/geometry.h"

namespace mtdb {

enum class PositionMode : uint8_t {
  kGrid = 0,      // position = origin + step * i
  kLossless = 1,  // i = the float32 coordinate's bits, made monotone; origin and step unused
  kRaster = 2,    // i.x, i.y number the samples of a raster; `plane` maps them to x and y, and
                  // z = origin.z + step * i.z
};

inline constexpr int kErrorStepsPerOctave = 8;

// float32 <-> int32, such that the integers have the same order as the floats (-0 and +0 differ).
// Not for NaN.
int32_t OrderedFromFloat(float f);
inline float FloatFromOrdered(int32_t i) {
  return std::bit_cast<float>(
      i >= 0 ? i : static_cast<int32_t>(static_cast<uint32_t>(i) ^ 0x7fffffffu));
}

// Positions: model units <-> int32. Errors: model units <-> one byte on a logarithmic scale of 1/8
// octave, code 0 = no error, code c = error_unit * 2^((c-1)/8). Deterministic on every machine.
struct Grid {
  PositionMode mode = PositionMode::kGrid;
  Vec3d origin;
  double step = 1;        // model units; > 0. Raster: of heights
  double error_unit = 1;  // model units; > 0
  // Raster: x = origin.x + plane[0] * i.x + plane[1] * i.y, y likewise with plane[2] and plane[3];
  // its determinant is positive.
  std::array<double, 4> plane{1, 0, 0, 1};

  // True when integers are steps, so that geometry may be done on them.
  bool is_linear() const { return mode != PositionMode::kLossless; }
  // The nearest point of the grid. `p` must be finite. A coordinate beyond the grid's 2^32 cells is
  // moved to the outermost cell.
  Vec3i Quantize(Vec3d p) const;
  Vec3d Position(Vec3i i) const {
    if (mode == PositionMode::kLossless) {
      return {FloatFromOrdered(i.x), FloatFromOrdered(i.y), FloatFromOrdered(i.z)};
    }
    if (mode == PositionMode::kRaster) {
      return {origin.x + plane[0] * i.x + plane[1] * i.y,
              origin.y + plane[2] * i.x + plane[3] * i.y, origin.z + step * i.z};
    }
    return {origin.x + step * i.x, origin.y + step * i.y, origin.z + step * i.z};
  }
  // Around the positions of all points of the box.
  Box3d Bounds(const Box3i& box) const;
  // An upper bound of the distance from an input vertex p to its stored position, in model units.
  // It includes the rounding errors of Position's arithmetic. At most cell_error() inside of the
  // grid; 0 when lossless and p is float32.
  double Displacement(Vec3d p) const;
  // Half a cell's diagonal and a little; 0 when lossless. Raster: half a step of heights, since
  // samples lie where they are.
  double cell_error() const;
  // Whether all positions inside the bounds are float32 values.
  bool FitsFloat(const Box3d& bounds) const;
  // The smallest code whose error is at least `error` (>= 0); 255 when none is.
  uint8_t ErrorCode(double error) const;
  double Error(uint8_t code) const;

  friend bool operator==(const Grid&, const Grid&) = default;
};

}  // namespace mtdb
