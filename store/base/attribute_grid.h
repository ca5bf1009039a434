// The grids that a VertexAttribute may promise: multiples of a step, and points of the octahedron.
// IEEE operations that are correctly rounded only, so that every machine finds the same codes.
#pragma once

#include <cstdint>

#include "store/base/attributes.h"
#include "store/base/geometry.h"

namespace mtdb {

inline constexpr int kMinNormalBits = 4;
inline constexpr int kMaxNormalBits = 16;
// A code beyond is not told from its neighbours by the type.
constexpr int64_t MaxScalarCode(ScalarType type) {
  return int64_t{1} << (type == ScalarType::kFloat32 ? 22 : 51);
}

// Whether steps are of floats and above 0, and normals three float32 of legal bits, without steps.
bool IsValidLayout(const AttributeLayout& layout);

// The multiple of `step` nearest to `value`, of which ScalarOfCode is at most step / 2 away and the
// half of a float's last place; 0 when the value is not finite or lies beyond 2^52 steps.
int64_t ScalarCode(double value, double step);
// As the type's nearest; its ScalarCode is `code` up to MaxScalarCode(type). 0 on overflow.
float Float32OfCode(int64_t code, double step);
double Float64OfCode(int64_t code, double step);

// A direction as a point of the unit octahedron, unfolded to the square [-c, c]^2 with
// c = OctahedralCentre(bits): the half z >= 0 is |s| + |t| <= c, the other one is folded outwards
// (Meyer et al., "On Floating-Point Normal Vectors", 2010). Points of the square's border that
// coincide on the octahedron have one code.
struct OctahedralCode {
  int32_t s = 0;
  int32_t t = 0;
  friend bool operator==(const OctahedralCode&, const OctahedralCode&) = default;
};
constexpr int32_t OctahedralCentre(int bits) { return (1 << (bits - 1)) - 1; }
// Of any length; (0, 0, 1) when it is zero or not finite. The decoded normal is at most
// 2.13 / OctahedralCentre(bits) radians off, and has the same code.
OctahedralCode EncodeOctahedral(const Vec3d& normal, int bits);
// Of length 1, its coordinates rounded to float32.
Vec3d DecodeOctahedral(OctahedralCode code, int bits);

}  // namespace mtdb
