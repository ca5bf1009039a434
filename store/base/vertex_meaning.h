// SPDX-License-Identifier: Apache-2.0
// FindColours, FindNormals: what attributes mean, by their names and types.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "store/base/attributes.h"
#include "store/base/geometry.h"

namespace mtdb {

// Red, green, blue and perhaps alpha, all of one type. Integers of 16 bits without a sign mean
// parts of 65535, floats parts of one, other integers parts of 255; all in sRGB, as programs that
// write PLY have them.
struct ColourAttributes {
  int count = 0;  // 0 (none), 3 or 4
  ScalarType type = ScalarType::kUint8;
  std::array<size_t, 4> offsets{};  // in a row
  std::array<size_t, 4> indices{};  // in the layout
};
// "red", "green", "blue" (and "alpha"); else "diffuse_red" and so on; else "r", "g", "b" (and "a");
// in capital or small letters, of any type but int8. The first of these that is complete.
ColourAttributes FindColours(const AttributeLayout& layout);
// From 0 to 1: of a value of that type; cut where it is outside, 0 where it is not a number.
double ColourPart(const std::byte* value, ScalarType type);
// Whether ColourPart cuts it.
bool IsCutColour(const std::byte* value, ScalarType type);
// The nearest of 256.
uint8_t ColourByte(const std::byte* value, ScalarType type);

// The three coordinates of a normal, float32 or float64, of any length.
struct NormalAttributes {
  bool found = false;
  ScalarType type = ScalarType::kFloat32;
  std::array<size_t, 3> offsets{};
  std::array<size_t, 3> indices{};
};
// "nx", "ny", "nz"; else "normal_x" and so on; else "n_x" and so on; in capital or small letters.
NormalAttributes FindNormals(const AttributeLayout& layout);
// As they are in a row, also where they are not finite. FindNormals has found them.
Vec3d NormalIn(const std::byte* row, const NormalAttributes& normals);

// sRGB's transfer function (IEC 61966-2-1), of numbers from 0 to 1. A byte of sRGB comes back
// exactly from its linear value in 16 bits.
double LinearOfSrgb(double value);
double SrgbOfLinear(double value);

}  // namespace mtdb
