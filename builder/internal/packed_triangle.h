// SPDX-License-Identifier: Apache-2.0
// PackedTriangle: a triangle in few bytes, for temporary files.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstring>

#include "builder/internal/tile.h"

namespace mtdb::internal {

// Two bytes of flags, then what they say is there. Positions of 20 bits a coordinate, as almost
// all grids have them, take 8 bytes instead of 12; a triangle of the input has no history.
class PackedTriangle {
 public:
  static constexpr size_t kFlagBytes = 2;
  static constexpr size_t kMaxBytes = kFlagBytes + 12 + 36 + 16;

  // Writes up to kMaxBytes; returns how many.
  static size_t Pack(const TileTriangle& t, std::byte* to) {
    uint32_t all = 0;
    for (const Vec3i& p : t.positions) {
      all |= static_cast<uint32_t>(p.x) | static_cast<uint32_t>(p.y) | static_cast<uint32_t>(p.z);
    }
    const bool small = all >> kSmallBits == 0;
    const TileTriangle fresh{};
    const bool history = t.error != fresh.error || t.child != fresh.child ||
                         t.child_slot != fresh.child_slot || t.height != fresh.height;
    const std::byte* begin = to;
    *to++ = static_cast<std::byte>(small | history << 1 | t.explicit_arc << 2);
    *to++ = static_cast<std::byte>(t.border_edges | t.fixed_corners << 3);
    const auto put = [&](const auto& value) {
      std::memcpy(to, &value, sizeof(value));
      to += sizeof(value);
    };
    put(t.vertices);
    if (small) {
      for (const Vec3i& p : t.positions) put(PackPosition(p));
    } else {
      put(t.positions);
    }
    if (history) put(std::array{std::bit_cast<uint32_t>(t.error), t.child, t.child_slot, t.height});
    return static_cast<size_t>(to - begin);
  }

  // The bytes that follow these flags.
  static size_t BytesAfter(const std::byte* flags) {
    const auto f = static_cast<uint8_t>(flags[0]);
    return 12 + (f & 1 ? 24 : 36) + (f & 2 ? 16 : 0);
  }
  static void Unpack(std::array<std::byte, kFlagBytes> flags, const std::byte* from,
                     TileTriangle* t) {
    const auto f = static_cast<uint8_t>(flags[0]);
    *t = TileTriangle{};
    t->explicit_arc = f & 4;
    t->border_edges = static_cast<uint8_t>(flags[1]) & 7;
    t->fixed_corners = static_cast<uint8_t>(flags[1]) >> 3;
    const auto get = [&](auto* value) {
      std::memcpy(value, from, sizeof(*value));
      from += sizeof(*value);
    };
    get(&t->vertices);
    if (f & 1) {
      for (Vec3i& p : t->positions) {
        uint64_t bits = 0;
        get(&bits);
        p = UnpackPosition(bits);
      }
    } else {
      get(&t->positions);
    }
    if (f & 2) {
      get(&t->error);
      get(&t->child);
      get(&t->child_slot);
      get(&t->height);
    }
  }

  static constexpr int kSmallBits = 20;
  // Coordinates from 0 to 2^20 - 1; the four top bits stay 0.
  static uint64_t PackPosition(Vec3i p) {
    return static_cast<uint64_t>(p.x) | static_cast<uint64_t>(p.y) << kSmallBits |
           static_cast<uint64_t>(p.z) << (2 * kSmallBits);
  }
  static Vec3i UnpackPosition(uint64_t bits) {
    constexpr uint64_t kMask = (1u << kSmallBits) - 1;
    return {static_cast<int32_t>(bits & kMask), static_cast<int32_t>(bits >> kSmallBits & kMask),
            static_cast<int32_t>(bits >> (2 * kSmallBits) & kMask)};
  }
};

}  // namespace mtdb::internal
