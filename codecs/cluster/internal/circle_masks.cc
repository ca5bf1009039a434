// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/circle_masks.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace mtdb::internal {

Circle::Circle(LatticePoint a, LatticePoint b, LatticePoint c) : a_(a), b_(b), c_(c) {
  const LatticePoint p{b.x - a.x, b.y - a.y};
  const LatticePoint q{c.x - a.x, c.y - a.y};
  const int64_t pp = p.x * p.x + p.y * p.y;
  const int64_t qq = q.x * q.x + q.y * q.y;
  area_ = p.x * q.y - p.y * q.x;
  u_ = q.y * pp - p.y * qq;
  v_ = p.x * qq - q.x * pp;
}

Circle::Box Circle::box() const {
  const double scale = 0.5 / static_cast<double>(area_);
  const double u = static_cast<double>(u_) * scale;
  const double v = static_cast<double>(v_) * scale;
  const double radius = std::sqrt(u * u + v * v) + 1;
  const auto clamp = [](double x) {
    constexpr double kFar = 1 << 20;
    return static_cast<int64_t>(std::floor(std::clamp(x, -kFar, kFar)));
  };
  const double x = static_cast<double>(a_.x) + u;
  const double y = static_cast<double>(a_.y) + v;
  return {clamp(x - radius), clamp(x + radius + 1), clamp(y - radius), clamp(y + radius + 1)};
}

CircleMasks::CircleMasks() {
  static const std::vector<CircleMask> kMasks = MakeSmall();
  small_ = kMasks.data();
  table_.Reset(64);
}

std::vector<CircleMask> CircleMasks::MakeSmall() {
  std::vector<CircleMask> masks;
  for (int64_t bx = -kSmall; bx <= kSmall; ++bx) {
    for (int64_t by = -kSmall; by <= kSmall; ++by) {
      for (int64_t cx = -kSmall; cx <= kSmall; ++cx) {
        for (int64_t cy = -kSmall; cy <= kSmall; ++cy) {
          Set({{0, 0}, {bx, by}, {cx, cy}}, masks.emplace_back());
        }
      }
    }
  }
  return masks;
}

Disc CircleMasks::FindOther(LatticePoint a, LatticePoint b, LatticePoint c) {
  if (b < a && b < c) {
    std::swap(a, b);
    std::swap(b, c);
  } else if (c < a && c < b) {
    std::swap(a, c);
    std::swap(b, c);
  }
  constexpr int64_t kSide = Window::kSide;
  b = {b.x - a.x, b.y - a.y + kSide};
  c = {c.x - a.x, c.y - a.y + kSide};
  if (static_cast<uint64_t>(b.x | c.x | b.y | c.y) >= 2 * kSide) return {0, 0, nullptr};
  const auto shape = static_cast<uint32_t>(b.x << 15 | b.y << 10 | c.x << 5 | c.y);
  const CircleMask* const known = table_.Find(
      HashOfNumber(shape), [shape](const CircleMask* other) { return other->shape == shape; });
  const CircleMask& mask =
      known != nullptr ? *known : Add(shape, {b.x, b.y - kSide}, {c.x, c.y - kSide});
  if (mask.large) return {0, 0, nullptr};
  return {static_cast<int32_t>(a.x) + mask.x, static_cast<int32_t>(a.y) + mask.y, &mask};
}

const CircleMask& CircleMasks::Add(uint32_t shape, LatticePoint b, LatticePoint c) {
  CircleMask& added = *others_.emplace_back(std::make_unique<CircleMask>());
  added.shape = shape;
  Set({{0, 0}, b, c}, added);
  const auto hash_of = [](const CircleMask* mask) { return HashOfNumber(mask->shape); };
  if (2 * others_.size() > table_.size()) table_.Resize(2 * table_.size(), hash_of);
  table_.FindEmpty(hash_of(&added)) = &added;
  return added;
}

// The circle's first corner is (0, 0).
void CircleMasks::Set(const Circle& circle, CircleMask& mask) {
  if (circle.empty()) return;
  constexpr int64_t kSide = Window::kSide;
  const Circle::Box box = circle.box();
  mask.large = box.right - box.left > 32 || box.top - box.bottom > 32;
  if (mask.large) return;
  // |differences| are below 32: 32 bits suffice.
  constexpr size_t kSize = 32;
  const auto area = static_cast<int32_t>(circle.area_);
  int32_t power_of_column[kSize];
  uint32_t bit[kSize];
  for (size_t i = 0; i < kSize; ++i) {
    const int32_t x = static_cast<int32_t>(box.left) + static_cast<int32_t>(i);
    power_of_column[i] = area * x * x - static_cast<int32_t>(circle.u_) * x;
    bit[i] = uint32_t{1} << i;
  }
  uint32_t rows[kSize];
  uint32_t columns = 0;
  int64_t low = box.top;
  int64_t high = box.bottom;
  for (int64_t y = box.bottom; y < box.top; ++y) {
    const auto power = static_cast<int32_t>(circle.Power({0, y}));
    uint32_t bits = 0;
    uint32_t ties = 0;
    for (size_t i = 0; i < kSize; ++i) {
      bits |= power_of_column[i] + power < 0 ? bit[i] : 0;
      ties |= power_of_column[i] + power == 0 ? bit[i] : 0;
    }
    for (; ties != 0; ties &= ties - 1) {
      if (circle.Has({box.left + std::countr_zero(ties), y})) bits |= ties & -ties;
    }
    rows[y - box.bottom] = bits;
    columns |= bits;
    if (bits == 0) continue;
    low = std::min(low, y);
    high = y;
  }
  if (columns == 0) return;
  const int left = std::countr_zero(columns);
  mask.large = std::bit_width(columns) - left > kSide || high - low >= kSide;
  if (mask.large) return;
  mask.x = static_cast<int8_t>(box.left + left);
  mask.y = static_cast<int8_t>(low);
  mask.words = static_cast<uint32_t>(high - low + 4) / 4;
  for (int64_t y = low; y <= high; ++y) {
    mask.rows[static_cast<size_t>(4 + y - low)] =
        static_cast<uint16_t>(rows[y - box.bottom] >> left);
  }
}

}  // namespace mtdb::internal
