// Four binary32 or int32 numbers at once, in the compilers' portable vector types: each operation
// is the scalar one in each lane, so that every machine computes the same bits.
#pragma once

#include <cstdint>
#include <cstring>

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
// Towards zero.
inline Int4 ToInt(Float4 v) { return __builtin_convertvector(v, Int4); }
inline Float4 Min4(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 Max4(Float4 a, Float4 b) { return a > b ? a : b; }
inline Int4 Max4(Int4 a, Int4 b) { return a > b ? a : b; }
inline float SumLanes(Float4 v) { return (v[0] + v[1]) + (v[2] + v[3]); }

}  // namespace mtdb
