// What the noise needs of four floats at once, beside store/base/float4.h: its loops do not depend
// on what the optimiser recognises.
#pragma once

#include <bit>
#include <cmath>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include "store/base/float4.h"

// A function with this attribute is compiled twice on x86-64, and the processor's abilities choose
// when the program starts: the baseline lacks 32-bit multiplication and selection of lanes.
// Neither version fuses operations, so that results are the same. Clang does not take the attribute
// on the definition of a member; ThreadSanitizer is not awake yet when the choice is made.
#if defined(__x86_64__) && defined(__ELF__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define MTDB_SIMD_CLONES __attribute__((target_clones("sse4.1", "default")))
#else
#define MTDB_SIMD_CLONES
#endif

namespace mtdb {

inline constexpr int kLanes = 4;

inline Float4 Splat4(float x) { return Float4{x, x, x, x}; }
inline Float4 Abs4(Float4 a) {
  return std::bit_cast<Float4>(std::bit_cast<Word4>(a) & 0x7fffffffu);
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
  const Int4 i = ToInt(a);
  return i + (a < ToFloat(i));  // a true lane is -1
}

}  // namespace mtdb
