// SPDX-License-Identifier: Apache-2.0
// Four binary32 or int32 numbers at once, in the portable vector types of the compilers. An
// operation on a vector does the scalar operation in each lane, so that every machine computes the
// same bits.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

namespace mtdb {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));
using Word4 = uint32_t __attribute__((vector_size(16)));

template <typename Vector, typename T>
Vector Load4(const T* from) {
  static_assert(sizeof(T) == 4);
  Vector v;
  std::memcpy(&v, from, sizeof(v));
  return v;
}
template <typename T, typename Vector>
void Store4(T* to, Vector v) {
  static_assert(sizeof(T) == 4);
  std::memcpy(to, &v, sizeof(v));
}
inline Float4 ToFloat(Int4 v) { return __builtin_convertvector(v, Float4); }
// The difference, which wraps around so that it always fits.
inline Float4 Offset4(Word4 to, Word4 from) { return ToFloat(reinterpret_cast<Int4>(to - from)); }
// Towards zero.
inline Int4 ToInt(Float4 v) { return __builtin_convertvector(v, Int4); }
inline Float4 Splat4(float x) { return Float4{x, x, x, x}; }
inline Float4 Abs4(Float4 a) {
  return std::bit_cast<Float4>(std::bit_cast<Word4>(a) & 0x7fffffffu);
}
inline Float4 Sqrt4(Float4 a) {
#ifdef __SSE2__
  return std::bit_cast<Float4>(_mm_sqrt_ps(std::bit_cast<__m128>(a)));
#else
  for (int i = 0; i < 4; ++i) a[i] = std::sqrt(a[i]);
  return a;
#endif
}
// The largest integer not above each lane.
inline Int4 Floor4(Float4 a) {
  const Int4 i = ToInt(a);
  return i + (a < ToFloat(i));  // a true lane is -1
}
#ifdef __SSE2__
inline Float4 Min4(Float4 a, Float4 b) { return _mm_min_ps(a, b); }
inline Float4 Max4(Float4 a, Float4 b) { return _mm_max_ps(a, b); }
#else
inline Float4 Min4(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 Max4(Float4 a, Float4 b) { return a > b ? a : b; }
#endif
// (x, y, z, w) -> (y, z, x, w)
inline Float4 Turn(Float4 v) { return __builtin_shufflevector(v, v, 1, 2, 0, 3); }
// Of four vectors, the x, the y and the z.
struct Columns4 {
  Float4 x, y, z;
};
inline Columns4 Transpose(Float4 a, Float4 b, Float4 c, Float4 d) {
  const Float4 ab = __builtin_shufflevector(a, b, 0, 4, 1, 5);  // ax bx ay by
  const Float4 cd = __builtin_shufflevector(c, d, 0, 4, 1, 5);
  const Float4 ab_high = __builtin_shufflevector(a, b, 2, 6, 3, 7);
  const Float4 cd_high = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  return {__builtin_shufflevector(ab, cd, 0, 1, 4, 5), __builtin_shufflevector(ab, cd, 2, 3, 6, 7),
          __builtin_shufflevector(ab_high, cd_high, 0, 1, 4, 5)};
}
// Bit i: lane i of a mask is set.
inline uint32_t MaskBits(Int4 mask) {
#ifdef __SSE2__
  return static_cast<uint32_t>(_mm_movemask_ps(reinterpret_cast<__m128>(mask)));
#else
  return static_cast<uint32_t>(mask[0] & 1) | static_cast<uint32_t>(mask[1] & 2) |
         static_cast<uint32_t>(mask[2] & 4) | static_cast<uint32_t>(mask[3] & 8);
#endif
}

}  // namespace mtdb
