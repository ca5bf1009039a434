// Hilbert order of three-dimensional grid points.
#pragma once

#include <array>
#include <cstdint>

namespace mtdb {

inline constexpr int kHilbertBits = 21;  // per axis; a code has 63 bits

// Bit i of a 21-bit word moves to bit 3 * i.
constexpr uint64_t SpreadBits(uint64_t x) {
  x = (x | x << 32) & 0x001f00000000ffffull;
  x = (x | x << 16) & 0x001f0000ff0000ffull;
  x = (x | x << 8) & 0x100f00f00f00f00full;
  x = (x | x << 4) & 0x10c30c30c30c30c3ull;
  x = (x | x << 2) & 0x1249249249249249ull;
  return x;
}

// The position of a point on the Hilbert curve through the cube of 2^21 points a side. Each
// coordinate must be below 2^21. After J. Skilling, "Programming the Hilbert curve" (2004).
constexpr uint64_t HilbertCode(std::array<uint32_t, 3> p) {
  for (int bit = kHilbertBits - 1; bit > 0; --bit) {
    const uint32_t low = (1u << bit) - 1;
    for (uint32_t& v : p) {
      // A set bit inverts p[0] below it; a clear one exchanges p[0] and v there. No branches.
      const uint32_t set = 0u - (v >> bit & 1u);
      const uint32_t exchange = (p[0] ^ v) & low & ~set;
      p[0] ^= exchange | (low & set);
      if (&v != &p[0]) v ^= exchange;
    }
  }
  p[1] ^= p[0];
  p[2] ^= p[1];
  uint32_t t = 0;
  for (int bit = kHilbertBits - 1; bit > 0; --bit) {
    t ^= ((1u << bit) - 1) & (0u - (p[2] >> bit & 1u));
  }
  for (uint32_t& v : p) v ^= t;
  return SpreadBits(p[0]) << 2 | SpreadBits(p[1]) << 1 | SpreadBits(p[2]);
}

}  // namespace mtdb
