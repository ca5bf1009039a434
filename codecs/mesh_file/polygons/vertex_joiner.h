// SPDX-License-Identifier: Apache-2.0
// VertexJoiner: gives equal positions the same vertex index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/position_hash.h"

namespace mtdb::internal {

// For Vec3f or Vec3d. Indices are handed out in the order of first sight. Memory: room for the
// position of 3/4 of a hash table's vertices, and its 4-byte slots, which double when it is full.
template <typename Position>
class VertexJoiner {
 public:
  static constexpr size_t kMaxVertices = kNone32;

  // The index of the position; *added when it is a new one, size() has then grown. The caller
  // keeps size() below kMaxVertices. -0 equals +0. Not for NaN.
  uint32_t Add(Position p, bool* added) {
    p = p + Position{};  // -0 + 0 = +0
    if (full()) Grow();
    size_t slot = HashOfPosition(p) & (slots_.size() - 1);
    for (; slots_[slot] != kNone32; slot = (slot + 1) & (slots_.size() - 1)) {
      if (positions_[slots_[slot]] == p) {
        *added = false;
        return slots_[slot];
      }
    }
    *added = true;
    slots_[slot] = static_cast<uint32_t>(positions_.size());
    positions_.push_back(p);
    return slots_[slot];
  }
  size_t size() const { return positions_.size(); }
  // What the next vertex may make it take in bytes, at most and for a moment.
  uint64_t next_bytes() const { return full() ? 3 * PositionBytes(slots_.size()) : bytes_; }
  Position position(uint32_t index) const { return positions_[index]; }

 private:
  static size_t Room(size_t slots) { return slots / 4 * 3; }
  static uint64_t PositionBytes(size_t slots) { return uint64_t{Room(slots)} * sizeof(Position); }
  bool full() const { return positions_.size() >= Room(slots_.size()); }

  void Grow() {
    constexpr size_t kFirstSlots = 1024;
    const size_t size = slots_.empty() ? kFirstSlots : slots_.size() * 2;
    slots_ = {};  // its memory first
    positions_.reserve(Room(size));
    slots_.assign(size, kNone32);
    bytes_ = PositionBytes(size) + size * sizeof(uint32_t);
    for (size_t i = 0; i < positions_.size(); ++i) {
      size_t slot = HashOfPosition(positions_[i]) & (size - 1);
      while (slots_[slot] != kNone32) slot = (slot + 1) & (size - 1);
      slots_[slot] = static_cast<uint32_t>(i);
    }
  }

  std::vector<Position> positions_;
  std::vector<uint32_t> slots_;
  uint64_t bytes_ = 0;
};

}  // namespace mtdb::internal
