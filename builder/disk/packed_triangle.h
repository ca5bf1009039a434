// SPDX-License-Identifier: Apache-2.0
// TrianglePacker, TriangleUnpacker: a sequence of triangles in few bytes, for temporary files.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "builder/disk/packed_numbers.h"
#include "builder/disk/tile.h"
#include "store/base/bytes.h"

namespace mtdb::internal {

// The vertices that a sequence of triangles named last, with their rows. Of triangles that are
// neighbours, one after the other, most corners are among them.
class RecentVertices {
 public:
  static constexpr uint32_t kMost = 256;

  explicit RecentVertices(size_t row_bytes) : row_bytes_(row_bytes) {
    constexpr size_t kRowBytes = size_t{1} << 14;
    while (count_ > 1 && count_ * row_bytes > kRowBytes) count_ /= 2;
    rows_.resize(count_ * row_bytes);
  }

  // How many were added since, this one counted; 0: it is not known any more.
  uint32_t Find(uint32_t number, Vec3i position, const std::byte* row) const {
    const uint32_t back = added_ - places_[Slot(number)];
    if (back == 0 || back >= count_ || back > added_) return 0;
    if (Number(back) != number || Position(back) != position) return 0;
    return row_bytes_ == 0 || std::memcmp(Row(back), row, row_bytes_) == 0 ? back : 0;
  }
  // Of Find(), 1 .. kMost - 1; any number is safe.
  uint32_t Number(uint32_t back) const { return numbers_[At(back)]; }
  Vec3i Position(uint32_t back) const { return positions_[At(back)]; }
  const std::byte* Row(uint32_t back) const { return rows_.data() + At(back) * row_bytes_; }

  void Add(uint32_t number, Vec3i position, const std::byte* row) {
    const size_t at = added_ & (count_ - 1);
    numbers_[at] = number;
    positions_[at] = position;
    if (row_bytes_ != 0) std::memcpy(rows_.data() + at * row_bytes_, row, row_bytes_);
    places_[Slot(number)] = added_++;
  }

 private:
  static constexpr size_t kSlots = 1024;
  static size_t Slot(uint32_t number) { return number * 0x9e3779b1u >> 22; }
  size_t At(uint32_t back) const { return (added_ - back) & (count_ - 1); }

  size_t row_bytes_;
  uint32_t count_ = kMost;
  uint32_t added_ = 0;
  std::array<uint32_t, kMost> numbers_{};
  std::array<Vec3i, kMost> positions_{};
  Bytes rows_;
  std::array<uint32_t, kSlots> places_{};  // of numbers: what added_ was
};

// What both ends know of the triangles so far. A triangle is a byte of flags (an explicit arc, a
// history, edges or corners to name, and in four bits how many bytes the code's difference to the
// one before takes), then what they say is there. A corner is a byte, how far back its vertex was
// added, or 0 and the vertex: its number and position, as differences to those that were added
// last, and its row. A triangle of the input has no history.
class TrianglePacking {
 public:
  explicit TrianglePacking(size_t row_bytes) : row_bytes_(row_bytes), vertices_(row_bytes) {}
  // Of one triangle.
  size_t max_bytes() const {
    constexpr size_t kCorner = 1 + 4 * kMaxNearBytes;
    return 1 + 2 * 3 + sizeof(uint64_t) + 3 * (kCorner + row_bytes_) + sizeof(float) +
           kMaxNearBytes + 2 * kMaxVarintBytes;
  }

 protected:
  static constexpr uint8_t kExplicitArc = 1, kHistory = 2, kEdges = 4;
  static constexpr int kCodeShift = 3;
  const size_t row_bytes_;
  RecentVertices vertices_;
  uint64_t code_ = 0;
  uint32_t child_ = 0;
};

class TrianglePacker : public TrianglePacking {
 public:
  using TrianglePacking::TrianglePacking;

  // Codes do not fall. `rows` are those of the corners. Writes up to max_bytes(); returns how many.
  size_t Pack(const TileTriangle& t, const std::byte* rows, uint64_t code, std::byte* to) {
    const std::byte* const begin = to++;
    const TileTriangle fresh{};
    const bool history = t.error != fresh.error || t.child != fresh.child ||
                         t.child_slot != fresh.child_slot || t.height != fresh.height;
    const bool explicit_arc = t.explicit_arc();
    TileTriangle marks{};
    marks.edges = t.edges;
    marks.fans = t.fans;
    marks.set_explicit_arc(false);
    const bool has_marks = marks.edges != 0 || marks.fans != 0;
    if (has_marks) to = PutVarint(PutVarint(to, marks.edges), marks.fans);
    const uint64_t difference = code - code_;
    const auto code_bytes = static_cast<uint8_t>((std::bit_width(difference) + 7) / 8);
    std::memcpy(to, &difference, sizeof(difference));
    to += code_bytes;
    code_ = code;
    for (size_t c = 0; c < 3; ++c) {
      to = PutCorner(to, t.vertices[c], t.positions[c], rows + c * row_bytes_);
    }
    if (history) {
      std::memcpy(to, &t.error, sizeof(t.error));
      to = PutNear(to + sizeof(t.error), t.child, child_);
      to = PutVarint(PutVarint(to, t.child_slot), t.height);
      child_ = t.child;
    }
    *const_cast<std::byte*>(begin) =
        static_cast<std::byte>((explicit_arc ? kExplicitArc : 0) | (history ? kHistory : 0) |
                               (has_marks ? kEdges : 0) | code_bytes << kCodeShift);
    return static_cast<size_t>(to - begin);
  }

 private:
  std::byte* PutCorner(std::byte* to, uint32_t number, Vec3i position, const std::byte* row) {
    const uint32_t back = vertices_.Find(number, position, row);
    *to++ = static_cast<std::byte>(back);
    if (back != 0) return to;
    to = PutNear(to, number, vertices_.Number(1));
    to = PutNear(to, position, vertices_.Position(1));
    if (row_bytes_ != 0) std::memcpy(to, row, row_bytes_);
    vertices_.Add(number, position, row);
    return to + row_bytes_;
  }
};

class TriangleUnpacker : public TrianglePacking {
 public:
  using TrianglePacking::TrianglePacking;

  // Reads what Pack() wrote, of max_bytes() that may be looked at; returns the bytes after it.
  // `rows` has room for those of the corners.
  const std::byte* Unpack(const std::byte* from, TileTriangle* t, std::byte* rows, uint64_t* code) {
    const auto flags = static_cast<uint8_t>(*from++);
    *t = TileTriangle{};
    if (flags & kEdges) {
      uint64_t edges = 0, fans = 0;
      from = GetVarint(GetVarint(from, &edges), &fans);
      t->edges = static_cast<uint16_t>(edges);
      t->fans = static_cast<uint16_t>(fans);
    }
    t->set_explicit_arc((flags & kExplicitArc) != 0);
    const size_t code_bytes = std::min<size_t>(flags >> kCodeShift, sizeof(uint64_t));
    uint64_t difference = 0;
    std::memcpy(&difference, from, code_bytes);
    from += code_bytes;
    *code = code_ += difference;
    for (size_t c = 0; c < 3; ++c) {
      from = GetCorner(from, &t->vertices[c], &t->positions[c], rows + c * row_bytes_);
    }
    if (flags & kHistory) {
      uint64_t slot = 0, height = 0;
      std::memcpy(&t->error, from, sizeof(t->error));
      from = GetNear(from + sizeof(t->error), &t->child, child_);
      from = GetVarint(GetVarint(from, &slot), &height);
      t->child_slot = static_cast<uint32_t>(slot);
      t->height = static_cast<uint32_t>(height);
      child_ = t->child;
    }
    return from;
  }

 private:
  const std::byte* GetCorner(const std::byte* from, uint32_t* number, Vec3i* position,
                             std::byte* row) {
    const auto back = static_cast<uint32_t>(*from++);
    if (back != 0) {
      *number = vertices_.Number(back);
      *position = vertices_.Position(back);
      if (row_bytes_ != 0) std::memcpy(row, vertices_.Row(back), row_bytes_);
      return from;
    }
    from = GetNear(from, number, vertices_.Number(1));
    from = GetNear(from, position, vertices_.Position(1));
    if (row_bytes_ != 0) std::memcpy(row, from, row_bytes_);
    vertices_.Add(*number, *position, row);
    return from + row_bytes_;
  }
};

}  // namespace mtdb::internal
