// SPDX-License-Identifier: Apache-2.0
// The grids that the values of a VertexAttribute may lie on: the multiples of a step, and points of
// the octahedron. A code is the integer that names a point of a grid. All functions use only
// operations that IEEE 754 rounds correctly, so that every machine computes the same codes.
#pragma once

#include <cstdint>

#include "store/base/attributes.h"
#include "store/base/geometry.h"

namespace mtdb {

inline constexpr int kMinNormalBits = 4;
inline constexpr int kMaxNormalBits = 16;
// The largest code of a step, positive or negative, that values of the type can tell from the codes
// beside it.
constexpr int64_t MaxScalarCode(ScalarType type) {
  return int64_t{1} << (type == ScalarType::kFloat32 ? 22 : 51);
}

// True when only floats have steps, every step is finite and above 0, and every normal is three
// float32 attributes without steps, of which the first has kMinNormalBits to kMaxNormalBits bits.
bool IsValidLayout(const AttributeLayout& layout);

// The integer q for which q * step is nearest to `value`; 0 when `value` is not finite, or farther
// than 2^52 steps from 0.
int64_t ScalarCode(double value, double step);
// The value of a code: code * step, rounded to the type; 0 when that overflows the type. Rounding a
// value v to Float32OfCode(ScalarCode(v, step), step) moves it by at most step / 2 and half a unit
// in the float's last place. For codes up to MaxScalarCode(type), ScalarCode gives the code back.
float Float32OfCode(int64_t code, double step);
double Float64OfCode(int64_t code, double step);

// A direction, as a point of the unit octahedron that is unfolded to the square [-c, c]^2 with c =
// OctahedralCentre(bits): its half with z >= 0 is |s| + |t| <= c, the other half is folded outwards
// (Meyer et al., "On Floating-Point Normal Vectors", 2010). Points of the square's border that are
// the same point of the octahedron have the same code.
struct OctahedralCode {
  int32_t s = 0;
  int32_t t = 0;
  friend bool operator==(const OctahedralCode&, const OctahedralCode&) = default;
};
constexpr int32_t OctahedralCentre(int bits) { return (1 << (bits - 1)) - 1; }
// `normal` may have any length; a zero or non-finite one has the code of (0, 0, 1). The decoded
// normal differs from `normal` by at most 2.13 / OctahedralCentre(bits) radians, and has the same
// code.
OctahedralCode EncodeOctahedral(const Vec3d& normal, int bits);
// The direction of a code: of length 1, its coordinates rounded to float32.
Vec3d DecodeOctahedral(OctahedralCode code, int bits);

}  // namespace mtdb
