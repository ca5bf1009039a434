// Four binary32 numbers at once, in the compiler's portable vector type: each operation is the IEEE
// one in each lane, so that every machine computes the same bits.
#pragma once

#include <cstring>

namespace mtdb {

using Float4 = float __attribute__((vector_size(16)));

inline Float4 Load4(const float* from) {
  Float4 v;
  std::memcpy(&v, from, sizeof(v));
  return v;
}
inline void Store4(float* to, Float4 v) { std::memcpy(to, &v, sizeof(v)); }
inline float SumLanes(Float4 v) { return (v[0] + v[1]) + (v[2] + v[3]); }

}  // namespace mtdb
