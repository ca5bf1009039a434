// Four floats at once, in the vector notation of GCC and Clang: the loops of the noise do not
// depend on what the optimiser recognises. Each lane gets exactly what scalar code would.
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

// A function with this attribute is compiled twice on x86-64, and the processor's abilities choose
// when the program starts: the baseline lacks 32-bit multiplication and selection of lanes.
// Neither version fuses operations, so that results are the same. Clang does not take the attribute
// on the definition of a member.
#if defined(__x86_64__) && defined(__ELF__) && !defined(__clang__)
#define MTDB_SIMD_CLONES __attribute__((target_clones("sse4.1", "default")))
#else
#define MTDB_SIMD_CLONES
#endif

namespace mtdb {

inline constexpr int kLanes = 4;
using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));
using Uint4 = uint32_t __attribute__((vector_size(16)));

inline Float4 Load4(const float* p) {
  Float4 v;
  std::memcpy(&v, p, sizeof(v));
  return v;
}
inline void Store4(float* p, Float4 v) { std::memcpy(p, &v, sizeof(v)); }
inline Float4 Splat4(float x) { return Float4{x, x, x, x}; }

inline Float4 Min4(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 Max4(Float4 a, Float4 b) { return a > b ? a : b; }
inline Float4 Abs4(Float4 a) {
  return std::bit_cast<Float4>(std::bit_cast<Uint4>(a) & 0x7fffffffu);
}
inline Float4 Sqrt4(Float4 a) {
#ifdef __SSE2__
  return std::bit_cast<Float4>(_mm_sqrt_ps(std::bit_cast<__m128>(a)));
#else
  for (int i = 0; i < kLanes; ++i) a[i] = std::sqrt(a[i]);
  return a;
#endif
}
// The largest integer not above each lane.
inline Int4 Floor4(Float4 a) {
  const Int4 i = __builtin_convertvector(a, Int4);
  return i + (a < __builtin_convertvector(i, Float4));  // a true lane is -1
}
inline Float4 ToFloat4(Int4 a) { return __builtin_convertvector(a, Float4); }

}  // namespace mtdb
