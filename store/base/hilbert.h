// SPDX-License-Identifier: Apache-2.0
// Hilbert order of three-dimensional grid points.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace mtdb {

inline constexpr int kHilbertBits = 21;  // per axis; a code has 63 bits

// The curve through a cube is eight turned and mirrored copies of itself, one in each octant. A
// state says how a copy is turned and mirrored. After J. Skilling, "Programming the Hilbert curve"
// (2004), but level by level.
struct HilbertState {
  std::array<uint8_t, 3> axis{0, 1, 2};  // which axis takes the place of each
  std::array<uint8_t, 3> mirrored{};     // 0 or 1
  uint8_t parity = 0;                    // of the Gray code so far

  constexpr size_t number() const {
    const size_t flags =
        static_cast<size_t>(mirrored[0] << 3 | mirrored[1] << 2 | mirrored[2] << 1 | parity);
    return (static_cast<size_t>(axis[0]) * 3 + axis[1]) << 4 | flags;
  }
  // Descends into the octant whose bits are `octant` (bit i: axis i); returns its place in the
  // order of the eight.
  constexpr uint8_t Descend(uint32_t octant) {
    std::array<uint8_t, 3> bit{};
    for (size_t i = 0; i < 3; ++i) {
      bit[i] = static_cast<uint8_t>((octant >> axis[i] & 1) ^ mirrored[i]);
    }
    for (size_t i = 0; i < 3; ++i) {
      if (bit[i]) {
        mirrored[0] ^= 1;
      } else {
        std::swap(axis[0], axis[i]);
        std::swap(mirrored[0], mirrored[i]);
      }
    }
    const auto gray1 = static_cast<uint8_t>(bit[0] ^ bit[1]);
    const auto gray2 = static_cast<uint8_t>(gray1 ^ bit[2]);
    const auto place =
        static_cast<uint8_t>((bit[0] ^ parity) << 2 | (gray1 ^ parity) << 1 | (gray2 ^ parity));
    parity ^= gray2;
    return place;
  }
};

// Per state and octant: 8 * the next state's number + the octant's place.
inline constexpr size_t kHilbertStates = 9 << 4;
inline constexpr auto kHilbertSteps = [] {
  std::array<std::array<uint16_t, 8>, kHilbertStates> steps{};
  for (uint8_t a = 0; a < 3; ++a) {
    for (uint8_t b = 0; b < 3; ++b) {
      if (a == b) continue;
      for (uint8_t flags = 0; flags < 16; ++flags) {
        const auto flag = [&](int i) { return static_cast<uint8_t>(flags >> i & 1); };
        const HilbertState state{
            {a, b, static_cast<uint8_t>(3 - a - b)}, {flag(3), flag(2), flag(1)}, flag(0)};
        for (uint32_t octant = 0; octant < 8; ++octant) {
          HilbertState next = state;
          const uint8_t place = next.Descend(octant);
          steps[state.number()][octant] = static_cast<uint16_t>(next.number() << 3 | place);
        }
      }
    }
  }
  return steps;
}();

// The position of a point on the Hilbert curve through the cube of 2^21 points a side. Each
// coordinate must be below 2^21.
constexpr uint64_t HilbertCode(std::array<uint32_t, 3> p) {
  uint64_t code = 0;
  size_t state = HilbertState{}.number();
  for (int bit = kHilbertBits - 1; bit >= 0; --bit) {
    const uint32_t octant = (p[0] >> bit & 1) | (p[1] >> bit & 1) << 1 | (p[2] >> bit & 1) << 2;
    const uint16_t step = kHilbertSteps[state][octant];
    code = code << 3 | (step & 7);
    state = step >> 3;
  }
  return code;
}

}  // namespace mtdb
