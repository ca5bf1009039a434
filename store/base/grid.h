// Grid: how an object's positions and errors become integers. One grid for a whole object.
#pragma once

#include <cstdint>

#include "store/base/geometry.h"

namespace mtdb {

enum class PositionMode : uint8_t {
  kGrid = 0,      // position = origin + step * i
  kLossless = 1,  // i = the float32 coordinate's bits, made monotone; origin and step unused
};

inline constexpr int kErrorStepsPerOctave = 8;

// Positions: model units <-> int32. Errors: model units <-> one byte on a logarithmic scale of 1/8
// octave, code 0 = no error, code c = error_unit * 2^((c-1)/8). Deterministic on every machine.
struct Grid {
  PositionMode mode = PositionMode::kGrid;
  Vec3d origin;
  double step = 1;        // model units; > 0
  double error_unit = 1;  // model units; > 0

  Vec3i Quantize(Vec3d p) const;
  Vec3d Position(Vec3i i) const;
  // The distance from an input vertex to its stored position is at most this: half a cell's
  // diagonal, and a little for rounding in double. 0 when lossless.
  double cell_error() const;
  // The smallest code whose error is at least `error` (>= 0); 255 when none is.
  uint8_t ErrorCode(double error) const;
  double Error(uint8_t code) const;

  friend bool operator==(const Grid&, const Grid&) = default;
};

// float32 <-> int32 that orders alike (-0 and +0 differ). Not for NaN.
int32_t OrderedFromFloat(float f);
float FloatFromOrdered(int32_t i);

}  // namespace mtdb
