// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/internal/lattice.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

namespace mtdb::internal {

namespace {

constexpr int64_t kMaxSide = int64_t{1} << 13;  // so that the circle test fits int64_t
constexpr int64_t kMaxPointsPerNode = 64;
constexpr int64_t kMaxAsked = 4096;  // points, per node

uint32_t CountBits(uint64_t word) {
  word -= word >> 1 & 0x5555555555555555;
  word = (word & 0x3333333333333333) + (word >> 2 & 0x3333333333333333);
  word = (word + (word >> 4)) & 0x0f0f0f0f0f0f0f0f;
  return static_cast<uint32_t>(word * 0x0101010101010101 >> 56);
}

uint32_t CountPoints(const Window& window) {
  uint32_t count = 0;
  for (uint32_t w = 0; w < window.used; ++w) count += CountBits(window.words[w]);
  return count;
}

template <typename Visit>
void ForEachPoint(const Window& window, Visit&& visit) {
  for (uint32_t w = 0; w < window.used; ++w) {
    for (uint64_t bits = window.words[w]; bits != 0; bits &= bits - 1) {
      const int bit = std::countr_zero(bits);
      const LatticePoint p{window.x + bit % 16, window.y + 4 * static_cast<int32_t>(w) + bit / 16};
      visit(p, w, bits & -bits);
    }
  }
}

}  // namespace

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
  // Behind a row lies as much as is read beyond a window.
  l.words_ = (Window::kSide + l.width_ + 32 + 63) / 64;
  l.free_.resize(static_cast<size_t>(l.words_ * (l.height_ + 2 * Window::kSide)));
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
  l.discs_.reserve(patch.slots() + 6 * nodes);
  l.AddDiscs(patch);
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

void Lattice::AddVertex(const Patch& patch, LatticePoint p) {
  vertices_.push_back(p);
  Clear(p);
  AddDiscs(patch);
}

void Lattice::AddDiscs(const Patch& patch) {
  for (auto slot = static_cast<uint32_t>(discs_.size()); slot < patch.slots(); ++slot) {
    const auto& c = patch.triangle(slot).corners;
    discs_.push_back(masks_.Find(vertices_[c[0]], vertices_[c[1]], vertices_[c[2]]));
  }
}

Circle Lattice::CircleOf(const Patch& patch, uint32_t slot) const {
  const auto& corners = patch.triangle(slot).corners;
  return {vertices_[corners[0]], vertices_[corners[1]], vertices_[corners[2]]};
}

// Sets the words that are used to the free points. Returns whether there are any.
inline bool Lattice::Gather(Window& window) const {
  const int64_t x = window.x + Window::kSide;
  const int64_t pitch = words_ * 8;
  const auto* row = reinterpret_cast<const uint8_t*>(free_.data()) +
                    (window.y + Window::kSide) * pitch + (x >> 3);
  uint64_t any = 0;
  for (uint32_t w = 0; w < window.used; ++w, row += 4 * pitch) {
    uint32_t bits[4];
    for (int r = 0; r < 4; ++r) std::memcpy(&bits[r], row + r * pitch, sizeof(bits[r]));
    uint64_t word = 0;
    for (int r = 0; r < 4; ++r) {
      word |= static_cast<uint64_t>(static_cast<uint16_t>(bits[r] >> (x & 7))) << 16 * r;
    }
    window.words[w] = word;
    any |= word;
  }
  return any != 0;
}

// Of an anchor whose circle fits no window.
void Lattice::GatherLarge(const Circle& circle) {
  windows_.clear();
  if (circle.empty()) return;
  Circle::Box box = circle.box();
  box = {std::max<int64_t>(box.left, 0), std::min(box.right, width_),
         std::max<int64_t>(box.bottom, 0), std::min(box.top, height_)};
  for (int64_t y = box.bottom; y < box.top; y += Window::kSide) {
    for (int64_t x = box.left; x < box.right; x += Window::kSide) {
      budget_ -= Window::kSide;
      if (exhausted()) return;
      Window window{static_cast<int32_t>(x), static_cast<int32_t>(y), 4, {}};
      if (!Gather(window)) continue;
      ForEachPoint(window, [&](LatticePoint p, size_t word, uint64_t bit) {
        --budget_;
        if (!circle.Has(p)) window.words[word] &= ~bit;
      });
      if ((window.words[0] | window.words[1] | window.words[2] | window.words[3]) != 0) {
        windows_.push_back(window);
      }
    }
  }
}

void Lattice::SetAnchor(const Patch& patch, uint32_t anchor) {
  count_ = 0;
  const Disc disc = discs_[anchor];
  if (disc.large()) {
    GatherLarge(CircleOf(patch, anchor));
    if (windows_.empty()) return;
  } else {
    windows_.resize(1);
    Window& window = windows_[0];
    window = {disc.x, disc.y, disc.mask->words, {}};
    if (!Gather(window)) return;
    for (uint32_t w = 0; w < window.used; ++w) window.words[w] &= disc.OwnWord(w);
  }
  for (const uint32_t o : patch.triangle(anchor).opposite) {
    if (o != kNone32 && o >> 2 > anchor) Drop(patch, o >> 2);
  }
  for (const Window& window : windows_) count_ += CountPoints(window);
}

// Drops the candidates in the circle of the triangle in `slot`.
void Lattice::Drop(const Patch& patch, uint32_t slot) {
  if (const Disc disc = discs_[slot]; !disc.large()) {
    budget_ -= static_cast<int64_t>(windows_.size()) - 1;
    for (Window& window : windows_) {
      for (uint32_t w = 0; w < window.used; ++w) {
        window.words[w] &= ~disc.InWord(window.x, window.y + 4 * static_cast<int32_t>(w));
      }
    }
    return;
  }
  const Circle circle = CircleOf(patch, slot);
  for (Window& window : windows_) {
    budget_ -= CountPoints(window);
    ForEachPoint(window, [&](LatticePoint p, size_t word, uint64_t bit) {
      if (circle.Has(p)) window.words[word] &= ~bit;
    });
  }
}

uint32_t Lattice::CountInsideWindow(Disc disc) {
  const Window& window = windows_[0];
  Window& inside = inside_[0];
  uint64_t some = 0;  // points inside
  uint64_t rest = 0;  // others
  for (uint32_t w = 0; w < window.used; ++w) {
    const uint64_t word = window.words[w];
    const uint64_t in = word & disc.InWord(window.x, window.y + 4 * static_cast<int32_t>(w));
    inside.words[w] = in;
    some |= in;
    rest |= word ^ in;
  }
  inside_count_ = 0;
  if (some == 0) return 0;
  if (rest == 0) return inside_count_ = count_;
  for (uint32_t w = 0; w < window.used; ++w) inside_count_ += CountBits(inside.words[w]);
  return inside_count_;
}

// Of a large circle, or of candidates of an anchor that had one.
uint32_t Lattice::CountInsideLarge(const Patch& patch, uint32_t slot) {
  inside_ = windows_;
  if (windows_.empty()) inside_.resize(1);
  inside_count_ = 0;
  const Disc disc = discs_[slot];
  budget_ -= disc.large() ? count_ : static_cast<int64_t>(windows_.size());
  const Circle circle = CircleOf(patch, slot);
  for (Window& window : inside_) {
    if (disc.large()) {
      ForEachPoint(window, [&](LatticePoint p, size_t word, uint64_t bit) {
        if (!circle.Has(p)) window.words[word] &= ~bit;
      });
    } else {
      for (uint32_t w = 0; w < window.used; ++w) {
        window.words[w] &= disc.InWord(window.x, window.y + 4 * static_cast<int32_t>(w));
      }
    }
    inside_count_ += CountPoints(window);
  }
  return inside_count_;
}

void Lattice::Keep(bool inside) {
  const uint32_t count = inside ? inside_count_ : count_ - inside_count_;
  if (count == count_) return;
  count_ = count;
  for (size_t i = 0; i < windows_.size(); ++i) {
    Window& window = windows_[i];
    for (uint32_t w = 0; w < window.used; ++w) {
      const uint64_t in = inside_[i].words[w];
      window.words[w] = inside ? in : window.words[w] & ~in;
    }
  }
}

void Lattice::Exclude(const Patch& patch, const Patch::Hole& hole, uint32_t anchor) {
  for (uint32_t j = 0; j < hole.ring_count; ++j) {
    const uint32_t o = hole.outer[j];
    if (o != kNone32 && o >> 2 > anchor) Drop(patch, o >> 2);
  }
  count_ = 0;
  for (const Window& window : windows_) count_ += CountPoints(window);
}

void Lattice::ListCandidates() {
  listed_.clear();
  // Windows beside each other share rows.
  for (size_t begin = 0, end = 0; begin < windows_.size(); begin = end) {
    const Window& first = windows_[begin];
    while (end < windows_.size() && windows_[end].y == first.y) ++end;
    for (uint32_t y = 0; y < 4 * first.used; ++y) {
      for (size_t i = begin; i < end; ++i) {
        auto bits = static_cast<uint16_t>(windows_[i].words[y / 4] >> 16 * (y % 4));
        for (; bits != 0; bits &= bits - 1) {
          listed_.push_back({windows_[i].x + std::countr_zero(bits), first.y + int64_t{y}});
        }
      }
    }
  }
}

LatticePoint Lattice::candidate(uint32_t number) {
  ListCandidates();
  return listed_[number];
}

uint32_t Lattice::NumberOf(LatticePoint candidate) {
  ListCandidates();
  return static_cast<uint32_t>(std::find(listed_.begin(), listed_.end(), candidate) -
                               listed_.begin());
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
