// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/lattice.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <utility>

namespace mtdb::internal {

namespace {

constexpr int64_t kMaxSide = int64_t{1} << 13;  // so that the circle test fits int64_t
constexpr int64_t kMaxPointsPerNode = 64;
constexpr int64_t kMaxAsked = 4096;  // points, per node

}  // namespace

[[gnu::always_inline]] inline bool Lattice::IsInside(const Circle& circle, LatticePoint p) {
  if (circle.area <= 0) return false;
  const int64_t x = p.x - circle.a.x;
  const int64_t y = p.y - circle.a.y;
  const int64_t power = circle.area * (x * x + y * y) - circle.u * x - circle.v * y;
  if (power == 0) [[unlikely]]
    return TieIsInCircle(circle.a, circle.b, circle.c, p);
  return power < 0;
}

std::optional<Lattice> Lattice::Make(const Patch& patch, std::span<const Vec3i> positions,
                                     size_t nodes, bool with_border) {
  if (positions.empty()) return {};
  Vec3i low = positions[0];
  Vec3i high = positions[0];
  for (const Vec3i p : positions) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), 0};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), 0};
  }
  Lattice l;
  l.origin_ = {low.x, low.y};
  l.width_ = int64_t{high.x} - low.x + 1;
  l.height_ = int64_t{high.y} - low.y + 1;
  if (l.width_ > kMaxSide || l.height_ > kMaxSide) return {};
  if (l.width_ * l.height_ > kMaxPointsPerNode * static_cast<int64_t>(nodes)) return {};
  l.words_ = (l.width_ + 63) / 64;
  l.free_.resize(static_cast<size_t>(l.words_ * l.height_));
  l.vertices_.reserve(positions.size() + nodes);
  for (const Vec3i p : positions) l.vertices_.push_back(l.ToLattice(p));
  l.budget_ = kMaxAsked * static_cast<int64_t>(nodes);

  const auto& v = l.vertices_;
  for (uint32_t slot = 0; slot < patch.slots() && !l.exhausted(); ++slot) {
    const auto& c = patch.triangle(slot).corners;
    l.FreeTriangle(v[c[0]], v[c[1]], v[c[2]]);
  }
  for (uint32_t slot = 0; slot < patch.slots() && !with_border; ++slot) {
    const Patch::Triangle& t = patch.triangle(slot);
    for (uint32_t i = 0; i < 3; ++i) {
      if (t.opposite[i] == kNone32) l.ClearEdge(v[t.corners[i]], v[t.corners[(i + 1) % 3]]);
    }
  }
  for (const LatticePoint p : v) l.Clear(p);
  return l;
}

// Frees the points inside and on the edges.
void Lattice::FreeTriangle(LatticePoint a, LatticePoint b, LatticePoint c) {
  if (Turn(a, b, c) <= 0) return;
  const auto [left, right] = std::minmax({a.x, b.x, c.x});
  const auto [bottom, top] = std::minmax({a.y, b.y, c.y});
  budget_ -= (right - left + 1) * (top - bottom + 1);
  if (exhausted()) return;
  for (int64_t y = bottom; y <= top; ++y) {
    for (int64_t x = left; x <= right; ++x) {
      const LatticePoint p{x, y};
      if (Turn(a, b, p) >= 0 && Turn(b, c, p) >= 0 && Turn(c, a, p) >= 0) SetFree(p);
    }
  }
}

void Lattice::ClearEdge(LatticePoint a, LatticePoint b) {
  const int64_t steps = std::gcd(b.x - a.x, b.y - a.y);
  for (int64_t i = 1; i < steps; ++i) {
    Clear({a.x + (b.x - a.x) / steps * i, a.y + (b.y - a.y) / steps * i});
  }
}

void Lattice::AddVertex(LatticePoint p) {
  vertices_.push_back(p);
  Clear(p);
}

Lattice::Circle Lattice::CircleOf(const Patch& patch, uint32_t slot) const {
  const auto& corners = patch.triangle(slot).corners;
  const LatticePoint a = vertices_[corners[0]];
  const LatticePoint b = vertices_[corners[1]];
  const LatticePoint c = vertices_[corners[2]];
  const LatticePoint p{b.x - a.x, b.y - a.y};
  const LatticePoint q{c.x - a.x, c.y - a.y};
  const int64_t pp = p.x * p.x + p.y * p.y;
  const int64_t qq = q.x * q.x + q.y * q.y;
  return {a, b, c, p.x * q.y - p.y * q.x, q.y * pp - p.y * qq, p.x * qq - q.x * pp};
}

void Lattice::SetAnchor(const Patch& patch, uint32_t anchor) {
  candidates_.clear();
  const Circle circle = CircleOf(patch, anchor);
  if (circle.area <= 0) return;
  Circle later[3];
  size_t later_count = 0;
  for (const uint32_t o : patch.triangle(anchor).opposite) {
    if (o != kNone32 && o >> 2 > anchor) later[later_count++] = CircleOf(patch, o >> 2);
  }
  // A window that holds the circle; which one does not matter.
  const double scale = 0.5 / static_cast<double>(circle.area);
  const double u = static_cast<double>(circle.u) * scale;
  const double v = static_cast<double>(circle.v) * scale;
  const double radius = std::sqrt(u * u + v * v) + 1;
  const auto clamp = [](double x, int64_t size) {
    return static_cast<int64_t>(std::clamp(x, 0.0, static_cast<double>(size)));
  };
  const auto from_x = static_cast<double>(circle.a.x) + u;
  const auto from_y = static_cast<double>(circle.a.y) + v;
  const int64_t left = clamp(from_x - radius, width_);
  const int64_t right = clamp(from_x + radius + 1, width_);
  const int64_t bottom = clamp(from_y - radius, height_);
  const int64_t top = clamp(from_y + radius + 1, height_);
  if (left >= right) return;
  const int64_t first = left >> 6;
  const int64_t last = (right - 1) >> 6;
  budget_ -= (top - bottom) * (last - first + 1);
  if (exhausted()) return;
  for (int64_t y = bottom; y < top; ++y) {
    for (int64_t word = first; word <= last; ++word) {
      uint64_t bits = free_[static_cast<size_t>(y * words_ + word)];
      if (word == first) bits &= ~uint64_t{0} << (left & 63);
      if (word == last) bits &= ~uint64_t{0} >> (63 - ((right - 1) & 63));
      for (; bits != 0; bits &= bits - 1) {
        const LatticePoint p{word * 64 + std::countr_zero(bits), y};
        --budget_;
        if (!IsInside(circle, p)) continue;
        bool is_later = false;
        for (size_t i = 0; i < later_count; ++i) is_later = is_later || IsInside(later[i], p);
        if (!is_later) candidates_.push_back(p);
      }
    }
  }
}

uint32_t Lattice::CountInside(const Patch& patch, uint32_t slot) {
  const Circle circle = CircleOf(patch, slot);
  budget_ -= static_cast<int64_t>(candidates_.size());
  inside_.resize(candidates_.size());
  uint32_t count = 0;
  for (size_t i = 0; i < candidates_.size(); ++i) {
    inside_[i] = IsInside(circle, candidates_[i]);
    count += inside_[i];
  }
  return count;
}

void Lattice::Keep(bool inside) {
  size_t count = 0;
  for (size_t i = 0; i < candidates_.size(); ++i) {
    if ((inside_[i] != 0) == inside) candidates_[count++] = candidates_[i];
  }
  candidates_.resize(count);
}

void Lattice::Exclude(const Patch& patch, const Patch::Hole& hole, uint32_t anchor) {
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    const uint32_t o = hole.outer[j];
    if (o == kNone32 || o >> 2 < anchor) continue;
    CountInside(patch, o >> 2);
    Keep(false);
  }
}

uint32_t Lattice::SplitEdge(const Patch::Hole& hole, LatticePoint p) const {
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    if (!hole.open_edge(j)) continue;
    const LatticePoint a = vertices_[hole.ring[j]];
    const LatticePoint b = vertices_[hole.ring[j + 1 == hole.ring_count ? 0 : j + 1]];
    if (Turn(a, b, p) == 0 && std::min(a.x, b.x) <= p.x && p.x <= std::max(a.x, b.x) &&
        std::min(a.y, b.y) <= p.y && p.y <= std::max(a.y, b.y)) {
      return j;
    }
  }
  return kNone32;
}

}  // namespace mtdb::internal
