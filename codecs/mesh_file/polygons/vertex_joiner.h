// SPDX-License-Identifier: Apache-2.0
// VertexJoiner: gives equal positions the same vertex index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/open_table.h"
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
    uint32_t& slot = table_.Find(HashOfPosition(p), [&](uint32_t i) { return positions_[i] == p; });
    *added = slot == kNone32;
    if (*added) {
      slot = static_cast<uint32_t>(positions_.size());
      positions_.push_back(p);
    }
    return slot;
  }
  size_t size() const { return positions_.size(); }
  // What the next vertex may make it take in bytes, at most and for a moment.
  uint64_t next_bytes() const { return full() ? 3 * PositionBytes(table_.size()) : bytes_; }
  Position position(uint32_t index) const { return positions_[index]; }

 private:
  static size_t Room(size_t slots) { return slots / 4 * 3; }
  static uint64_t PositionBytes(size_t slots) { return uint64_t{Room(slots)} * sizeof(Position); }
  bool full() const { return positions_.size() >= Room(table_.size()); }

  void Grow() {
    constexpr size_t kFirstSlots = 1024;
    const size_t size = table_.size() == 0 ? kFirstSlots : table_.size() * 2;
    table_.Release();  // its memory first
    positions_.reserve(Room(size));
    table_.Reset(size);
    bytes_ = PositionBytes(size) + size * sizeof(uint32_t);
    for (size_t i = 0; i < positions_.size(); ++i) {
      table_.FindEmpty(HashOfPosition(positions_[i])) = static_cast<uint32_t>(i);
    }
  }

  std::vector<Position> positions_;
  OpenTable<uint32_t> table_;  // indices
  uint64_t bytes_ = 0;
};

}  // namespace mtdb::internal
