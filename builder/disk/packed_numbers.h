// SPDX-License-Identifier: Apache-2.0
// Numbers in as many bytes as they need, for temporary files: seven bits a byte, the least first.
#pragma once

#include <cstddef>
#include <cstdint>

#include "store/base/geometry.h"

namespace mtdb::internal {

constexpr size_t kMaxVarintBytes = 10;

inline std::byte* PutVarint(std::byte* to, uint64_t value) {
  for (; value >= 0x80; value >>= 7) *to++ = static_cast<std::byte>(value | 0x80);
  *to++ = static_cast<std::byte>(value);
  return to;
}
// Reads kMaxVarintBytes at most, whatever is there.
inline const std::byte* GetVarint(const std::byte* from, uint64_t* value) {
  *value = 0;
  for (unsigned shift = 0; shift < 7 * kMaxVarintBytes; shift += 7) {
    const auto b = static_cast<uint64_t>(*from++);
    *value |= (b & 0x7f) << shift;
    if (b < 0x80) break;
  }
  return from;
}

// Small numbers of either sign as small ones.
inline uint64_t ZigZag(int64_t value) {
  return static_cast<uint64_t>(value) << 1 ^ static_cast<uint64_t>(value >> 63);
}
inline int64_t UnZigZag(uint64_t value) {
  return static_cast<int64_t>(value >> 1) ^ -static_cast<int64_t>(value & 1);
}

// `value`, which the reader has when it knows `near`.
inline std::byte* PutNear(std::byte* to, uint32_t value, uint32_t near) {
  return PutVarint(to, ZigZag(int64_t{value} - int64_t{near}));
}
inline const std::byte* GetNear(const std::byte* from, uint32_t* value, uint32_t near) {
  uint64_t difference = 0;
  from = GetVarint(from, &difference);
  *value = static_cast<uint32_t>(int64_t{near} + UnZigZag(difference));
  return from;
}
constexpr size_t kMaxNearBytes = 5;

inline std::byte* PutNear(std::byte* to, Vec3i value, Vec3i near) {
  for (int i = 0; i < 3; ++i) {
    to = PutNear(to, static_cast<uint32_t>(value[i]), static_cast<uint32_t>(near[i]));
  }
  return to;
}
inline const std::byte* GetNear(const std::byte* from, Vec3i* value, Vec3i near) {
  for (int i = 0; i < 3; ++i) {
    uint32_t coordinate = 0;
    from = GetNear(from, &coordinate, static_cast<uint32_t>(near[i]));
    (*value)[i] = static_cast<int32_t>(coordinate);
  }
  return from;
}

}  // namespace mtdb::internal
