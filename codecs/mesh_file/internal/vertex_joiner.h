// VertexJoiner: gives equal positions the same vertex index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/position_hash.h"

namespace mtdb::internal {

// For Vec3f or Vec3d. Indices are handed out in the order of first sight. Memory: the position of
// each vertex, and a hash table of 4-byte slots that is at most 3/4 full.
template <typename Position>
class VertexJoiner {
 public:
  static constexpr size_t kMaxVertices = kNone32;

  // The index of the position; *added when it is a new one, size() has then grown. The caller
  // keeps size() below kMaxVertices. -0 equals +0. Not for NaN.
  uint32_t Add(Position p, bool* added) {
    p = p + Position{};  // -0 + 0 = +0
    if (positions_.size() >= slots_.size() / 4 * 3) Grow();
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
  Position position(uint32_t index) const { return positions_[index]; }

 private:
  void Grow() {
    constexpr size_t kFirstSlots = 1024;
    const size_t size = slots_.empty() ? kFirstSlots : slots_.size() * 2;
    slots_.assign(size, kNone32);
    for (size_t i = 0; i < positions_.size(); ++i) {
      size_t slot = HashOfPosition(positions_[i]) & (size - 1);
      while (slots_[slot] != kNone32) slot = (slot + 1) & (size - 1);
      slots_[slot] = static_cast<uint32_t>(i);
    }
  }

  std::vector<Position> positions_;
  std::vector<uint32_t> slots_;
};

}  // namespace mtdb::internal
