#include "codecs/internal/patch.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>
#include <memory>
#include <utility>

#include "codecs/internal/float4.h"

namespace mtdb {

namespace {

// `facing`, `b` and `c` are squared lengths of a triangle's edges; the sharpness of the corner that
// the first of them faces. The fraction is at most 2, since the square of a sum is at most twice
// the sum of the squares; differences that wrap around may break that rule.
inline int32_t Sharpness(float facing, float b, float c) {
  const float fraction = 60 * facing / (b + c + 1e-30f);
  return 60 - static_cast<int32_t>(fraction < 120 ? fraction : 120);
}

// floor(log2(x)) for x >= 1, and 0 below.
inline int32_t Exponent(float x) {
  const int32_t exponent = (std::bit_cast<int32_t>(x) >> 23) - 127;
  return exponent < 0 ? 0 : exponent;
}

void SetShape(Patch::Triangle& t, float first, float second, float third) {
  t.sharpness = {static_cast<int8_t>(Sharpness(first, second, third)),
                 static_cast<int8_t>(Sharpness(second, third, first)),
                 static_cast<int8_t>(Sharpness(third, first, second))};
  t.length = {static_cast<uint8_t>(Exponent(first)), static_cast<uint8_t>(Exponent(second)),
              static_cast<uint8_t>(Exponent(third))};
  t.longest = std::max({t.length[0], t.length[1], t.length[2]});
}

inline float Squared(float x, float y, float z) { return x * x + y * y + z * z; }

float SquaredDistance(Vec3i a, Vec3i b) {
  return Squared(RingPoints::Offset(b.x, a.x), RingPoints::Offset(b.y, a.y),
                 RingPoints::Offset(b.z, a.z));
}

Int4 Sharpness4(Float4 facing, Float4 b, Float4 c) {
  const Float4 fraction = 60 * facing / (b + c + 1e-30f);
  return 60 - ToInt(Min4(fraction, Float4{120, 120, 120, 120}));
}

Int4 Exponent4(Float4 x) {
  Int4 bits;
  std::memcpy(&bits, &x, sizeof(bits));
  return Max4((bits >> 23) - 127, Int4{0, 0, 0, 0});
}

// The shapes of a star's triangles, as bytes of Patch::Triangle, four in a word: sharpness and 0;
// length and 0. The loop runs to a multiple of four.
struct StarShape {
  int32_t sharpness[3][RingPoints::kSize];
  uint32_t sharpness_word[RingPoints::kSize], length_word[RingPoints::kSize];
  uint32_t longest_word[RingPoints::kSize];  // longest << 24

  StarShape(const RingPoints& ring, Vec3i apex) {
    const float ax = RingPoints::Offset(apex.x, ring.base.x);
    const float ay = RingPoints::Offset(apex.y, ring.base.y);
    const float az = RingPoints::Offset(apex.z, ring.base.z);
    for (uint32_t j = 0; j < ring.count; j += 4) {
      const auto px = Load4<Float4>(ring.at[0] + j), qx = Load4<Float4>(ring.at[0] + j + 1);
      const auto py = Load4<Float4>(ring.at[1] + j), qy = Load4<Float4>(ring.at[1] + j + 1);
      const auto pz = Load4<Float4>(ring.at[2] + j), qz = Load4<Float4>(ring.at[2] + j + 1);
      const Float4 first = Squared4(px - ax, py - ay, pz - az);  // squared lengths
      const Float4 second = Squared4(qx - px, qy - py, qz - pz);
      const Float4 third = Squared4(qx - ax, qy - ay, qz - az);
      const Int4 s0 = Sharpness4(first, second, third);
      const Int4 s1 = Sharpness4(second, third, first);
      const Int4 s2 = Sharpness4(third, first, second);
      Store4(sharpness[0] + j, s0);
      Store4(sharpness[1] + j, s1);
      Store4(sharpness[2] + j, s2);
      Store4(sharpness_word + j, (s0 & 0xff) | (s1 & 0xff) << 8 | (s2 & 0xff) << 16);
      const Int4 a = Exponent4(first);
      const Int4 b = Exponent4(second);
      const Int4 c = Exponent4(third);
      Store4(length_word + j, a | b << 8 | c << 16);
      Store4(longest_word + j, Max4(Max4(a, b), c) << 24);
    }
  }
  static Float4 Squared4(Float4 x, Float4 y, Float4 z) { return x * x + y * y + z * z; }
};

}  // namespace

Patch::Patch(std::span<const std::array<uint32_t, 3>> in_triangles,
             const std::vector<Vec3i>& positions, size_t expected_slots) {
  removers_.reserve(expected_slots);
  capacity_ = std::max(expected_slots, in_triangles.size());
  triangles_ = std::make_unique_for_overwrite<Triangle[]>(capacity_);
  removers_.resize(in_triangles.size(), kNone32);
  for (size_t slot = 0; slot < in_triangles.size(); ++slot) {
    const auto& corners = in_triangles[slot];
    Triangle& t = triangles_[slot];
    t.corners = corners;
    t.opposite = {kNone32, kNone32, kNone32};
    t.both = {kBothZero, kBothZero, kBothZero};
    t.error_code = 0;
    t.unused = 0;
    const Vec3i a = positions[corners[0]];
    const Vec3i b = positions[corners[1]];
    const Vec3i c = positions[corners[2]];
    SetShape(t, SquaredDistance(a, b), SquaredDistance(b, c), SquaredDistance(c, a));
  }
  PairEdges();
}

// Pairs each directed edge with its reverse. An edge that occurs twice in one direction is
// non-manifold: it pairs with nothing.
void Patch::PairEdges() {
  const uint32_t n = slots();
  // Open addressing by undirected edge: its first half-edge, and how often each direction occurs.
  struct Entry {
    uint32_t half_edge = kNone32;
    uint8_t forward = 0, backward = 0;
  };
  const size_t capacity = std::bit_ceil(4 * size_t{n} + 2);
  std::vector<Entry> table(capacity);
  bool repeated = false;
  const auto find = [&](uint32_t slot, uint32_t i) -> Entry& {
    const auto& c = triangles_[slot].corners;
    const uint32_t from = c[i];
    const uint32_t to = c[i == 2 ? 0 : i + 1];
    const uint64_t edge = static_cast<uint64_t>(std::max(from, to)) << 32 | std::min(from, to);
    size_t at = (edge * 0x9e3779b97f4a7c15ull >> 32 ^ edge) & (capacity - 1);
    for (;; at = (at + 1) & (capacity - 1)) {
      Entry& e = table[at];
      if (e.half_edge == kNone32) return e;
      const auto& other = triangles_[e.half_edge >> 2].corners;
      const uint32_t other_from = other[e.half_edge & 3];
      const uint32_t other_to = other[(e.half_edge & 3) == 2 ? 0 : (e.half_edge & 3) + 1];
      if ((other_from == from && other_to == to) || (other_from == to && other_to == from)) {
        return e;
      }
    }
  };
  for (uint32_t slot = 0; slot < n; ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      Entry& e = find(slot, i);
      if (e.half_edge == kNone32) {
        e.half_edge = 4 * slot + i;
        e.forward = 1;
      } else if (triangles_[e.half_edge >> 2].corners[e.half_edge & 3] ==
                 triangles_[slot].corners[i]) {
        e.forward = 2;
        repeated = true;
      } else if (e.backward == 0) {
        e.backward = 1;
        Triangle& t = triangles_[slot];
        Triangle& other = triangles_[e.half_edge >> 2];
        t.opposite[i] = e.half_edge;
        other.opposite[e.half_edge & 3] = 4 * slot + i;
        t.both[i] = other.both[e.half_edge & 3] =
            static_cast<uint8_t>(kBothZero + t.sharpness[i] + other.sharpness[e.half_edge & 3]);
      } else {
        e.backward = 2;
        repeated = true;
      }
    }
  }
  if (!repeated) return;
  for (uint32_t slot = 0; slot < n; ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      const Entry& e = find(slot, i);
      if (e.forward > 1 || e.backward > 1) triangles_[slot].opposite[i] = kNone32;
    }
  }
}

// Makes room for `count` more slots, alive.
void Patch::Grow(uint32_t count) {
  const size_t before = removers_.size();
  removers_.resize(before + count, kNone32);
  if (removers_.size() <= capacity_) return;
  capacity_ = removers_.size() + removers_.size() / 2;
  auto larger = std::make_unique_for_overwrite<Triangle[]>(capacity_);
  std::copy_n(triangles_.get(), before, larger.get());
  triangles_ = std::move(larger);
}

void Patch::RotateRing(size_t split) {
  const size_t middle = split + 1 == ring_count_ ? 0 : split + 1;
  std::rotate(ring_.begin(), ring_.begin() + middle, ring_.begin() + ring_count_);
  std::rotate(outer_.begin(), outer_.begin() + middle, outer_.begin() + ring_count_);
}

void Patch::InsertStar(uint32_t vertex, Vec3i apex, const RingPoints& points, bool boundary,
                       uint8_t error_code) {
  const uint32_t k = ring_count_;
  const uint32_t count = boundary ? k - 1 : k;
  const uint32_t first = slots();
  const StarShape shape(points, apex);
  const uint32_t code = static_cast<uint32_t>(error_code) << 24;
  Grow(count);
  for (uint32_t j = 0; j < count; ++j) {
    const uint32_t slot = first + j;
    const uint32_t after = j + 1 == k ? 0 : j + 1;
    const uint32_t before = j == 0 ? k - 1 : j - 1;
    const uint32_t o = outer_[j];
    Triangle& t = triangles_[slot];
    t.corners = {vertex, ring_[j], ring_[after]};
    t.opposite = {4 * (first + before) + 2, o, 4 * (first + after)};
    const int32_t first_both = kBothZero + shape.sharpness[0][j] + shape.sharpness[2][before];
    const int32_t third_both = kBothZero + shape.sharpness[2][j] + shape.sharpness[0][after];
    int32_t second_both = kBothZero;
    if (o != kNone32) {
      Triangle& other = triangles_[o >> 2];
      other.opposite[o & 3] = 4 * slot + 1;
      second_both += shape.sharpness[1][j] + other.sharpness[o & 3];
      other.both[o & 3] = static_cast<uint8_t>(second_both);
    }
    const uint32_t words[3] = {
        shape.sharpness_word[j] | code,
        static_cast<uint32_t>(first_both | second_both << 8 | third_both << 16) |
            shape.longest_word[j],
        shape.length_word[j]};
    static_assert(offsetof(Triangle, length) == offsetof(Triangle, sharpness) + 8);
    std::memcpy(&t.sharpness, words, sizeof(words));
  }
  if (!boundary) return;
  triangles_[first].opposite[0] = kNone32;
  triangles_[first + count - 1].opposite[2] = kNone32;
  // A split edge's neighbour, if any, is a neighbour no more.
  if (const uint32_t o = outer_[k - 1]; o != kNone32) triangles_[o >> 2].opposite[o & 3] = kNone32;
}

}  // namespace mtdb
