// SPDX-License-Identifier: Apache-2.0
// CircleMasks: which points of a lattice lie in the circles of triangles. Triangles of one shape
// have one mask, since the Delaunay rule asks only how points lie to each other.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "store/base/ids.h"
#include "store/base/in_circle.h"
#include "store/base/open_table.h"

namespace mtdb::internal {

// The circle through three points; empty when these do not run counter-clockwise. Differences of
// points are below 2^13, so that 64 bits suffice.
class Circle {
 public:
  Circle(LatticePoint a, LatticePoint b, LatticePoint c);
  bool empty() const { return area_ <= 0; }
  // Points count as inside as the Delaunay rule says, ties included.
  bool Has(LatticePoint p) const {
    if (empty()) return false;
    const int64_t power = Power({p.x - a_.x, p.y - a_.y});
    if (power == 0) [[unlikely]]
      return TieIsInCircle(a_, b_, c_, p);
    return power < 0;
  }
  struct Box {
    int64_t left, right, bottom, top;  // right and top are outside
  };
  // One that holds the circle, or as much of it as a lattice can have; not of an empty circle.
  Box box() const;

 private:
  friend class CircleMasks;
  // Of p - a: negative inside, 0 on the circle.
  int64_t Power(LatticePoint p) const {
    return area_ * (p.x * p.x + p.y * p.y) - u_ * p.x - v_ * p.y;
  }

  LatticePoint a_, b_, c_;
  int64_t area_, u_, v_;
};

// Points of a window of 16 columns and rows: words of four rows each.
struct Window {
  static constexpr int32_t kSide = 16;
  int32_t x = 0, y = 0;  // of the first point
  uint32_t used = 0;     // words
  std::array<uint64_t, 4> words{};
};

// Which points of a window are inside a circle: bits of rows.
struct alignas(64) CircleMask {
  std::array<uint16_t, 4 + Window::kSide + 4> rows{};  // the first four and the last are 0
  uint32_t words = 0;                                  // of the window that may have points
  uint32_t shape = 0;                                  // of the triangle
  int8_t x = 0, y = 0;  // the window's first point, from the triangle's first corner
  bool large = false;   // no window holds the circle's points
};

// Where the circle of a triangle lies.
struct Disc {
  // Per shift of columns, from -15 on: those that are in both windows, in each of four rows.
  static constexpr auto kColumns = [] {
    std::array<uint64_t, 2 * Window::kSide - 1> columns{};
    for (size_t i = 0; i < columns.size(); ++i) {
      const uint64_t row = i < 15 ? 0xffffu >> (15 - i) : 0xffffu << (i - 15) & 0xffff;
      columns[i] = 0x0001000100010001 * row;
    }
    return columns;
  }();

  // Its points among those of a word of a window, whose first one is (from_x, from_y).
  uint64_t InWord(int32_t from_x, int32_t from_y) const {
    const int32_t right = x - from_x;
    const int32_t up = y - from_y;
    constexpr int32_t kSide = Window::kSide;
    if (static_cast<uint32_t>(right + kSide - 1) >= 2 * kSide - 1) return 0;
    if (static_cast<uint32_t>(up + kSide - 1) >= kSide + 3) return 0;
    uint64_t word;
    std::memcpy(&word, mask->rows.data() + 4 - up, sizeof(word));
    return std::rotl(word, right) & kColumns[static_cast<size_t>(right + kSide - 1)];
  }
  // Those of a word of its own window.
  uint64_t OwnWord(size_t w) const {
    uint64_t word;
    std::memcpy(&word, mask->rows.data() + 4 + 4 * w, sizeof(word));
    return word;
  }
  bool large() const { return mask == nullptr; }

  int32_t x, y;            // the window's first point
  const CircleMask* mask;  // nullptr when large; lives as long as CircleMasks
};

class CircleMasks {
 public:
  CircleMasks();
  Disc Find(LatticePoint a, LatticePoint b, LatticePoint c) {
    const uint32_t shape = SmallShape(b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y);
    if (shape == kNone32 || small_[shape].large) [[unlikely]]
      return FindOther(a, b, c);
    const CircleMask& mask = small_[shape];
    return {static_cast<int32_t>(a.x) + mask.x, static_cast<int32_t>(a.y) + mask.y, &mask};
  }

 private:
  // Shapes of most triangles have masks that all clusters share: differences are within +-kSmall.
  static constexpr int64_t kSmall = 4;
  static uint32_t SmallShape(int64_t bx, int64_t by, int64_t cx, int64_t cy);
  static std::vector<CircleMask> MakeSmall();
  static void Set(const Circle& circle, CircleMask& mask);
  Disc FindOther(LatticePoint a, LatticePoint b, LatticePoint c);
  const CircleMask& Add(uint32_t shape, LatticePoint b, LatticePoint c);

  const CircleMask* small_;
  std::vector<std::unique_ptr<CircleMask>> others_;
  OpenTable<const CircleMask*> table_;  // others_ by shape
};

inline uint32_t CircleMasks::SmallShape(int64_t bx, int64_t by, int64_t cx, int64_t cy) {
  constexpr uint64_t kCount = 2 * kSmall + 1;
  const auto x = static_cast<uint64_t>(bx + kSmall);
  const auto y = static_cast<uint64_t>(by + kSmall);
  const auto z = static_cast<uint64_t>(cx + kSmall);
  const auto w = static_cast<uint64_t>(cy + kSmall);
  if (x >= kCount || y >= kCount || z >= kCount || w >= kCount) return kNone32;
  return static_cast<uint32_t>(((x * kCount + y) * kCount + z) * kCount + w);
}

}  // namespace mtdb::internal
