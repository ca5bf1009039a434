#include "codecs/internal/patch.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>

#include "store/base/hash.h"

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

// The shapes of a star's triangles. Squared lengths: spoke[j] of the edge to ring vertex j, edge[j]
// of ring edge j. The results are bytes of Patch::Triangle, four in a word: sharpness and 0; both
// (but for the ring edge) and longest; length and 0. Loops run to multiples of four, for the
// compiler's sake.
struct StarShape {
  static constexpr size_t kSize = RingPoints::kSize;
  float spoke[kSize], edge[kSize];
  int32_t sharpness[3][kSize + 1], length[kSize];  // of a spoke's corners: sharpness[2] from 1
  uint32_t sharpness_word[kSize], both_word[kSize], length_word[kSize];

  void Compute(const RingPoints& ring, Vec3i apex) {
    const uint32_t count = ring.count;
    const float x = RingPoints::Offset(apex.x, ring.base.x);
    const float y = RingPoints::Offset(apex.y, ring.base.y);
    const float z = RingPoints::Offset(apex.z, ring.base.z);
    const uint32_t padded = (count + 3) / 4 * 4;
    for (uint32_t j = 0; j < padded + 4; ++j) {
      spoke[j] = Squared(ring.at[0][j] - x, ring.at[1][j] - y, ring.at[2][j] - z);
      edge[j] = Squared(ring.at[0][j + 1] - ring.at[0][j], ring.at[1][j + 1] - ring.at[1][j],
                        ring.at[2][j + 1] - ring.at[2][j]);
      length[j] = Exponent(spoke[j]);
    }
    for (uint32_t j = 0; j < padded; ++j) {
      sharpness[0][j] = Sharpness(spoke[j], edge[j], spoke[j + 1]);
      sharpness[1][j] = Sharpness(edge[j], spoke[j + 1], spoke[j]);
      sharpness[2][j + 1] = Sharpness(spoke[j + 1], spoke[j], edge[j]);
    }
    sharpness[0][count] = sharpness[0][0];
    sharpness[2][0] = sharpness[2][count];
    for (uint32_t j = 0; j < padded; ++j) {
      const int32_t a = length[j];
      const int32_t b = Exponent(edge[j]);
      const int32_t c = length[j + 1];
      int32_t longest = a > b ? a : b;
      longest = longest > c ? longest : c;
      length_word[j] = static_cast<uint32_t>(a | b << 8 | c << 16);
      sharpness_word[j] =
          static_cast<uint32_t>((sharpness[0][j] & 0xff) | (sharpness[1][j] & 0xff) << 8 |
                                (sharpness[2][j + 1] & 0xff) << 16);
      const int32_t first = Patch::kBothZero + sharpness[0][j] + sharpness[2][j];
      const int32_t third = Patch::kBothZero + sharpness[2][j + 1] + sharpness[0][j + 1];
      both_word[j] =
          static_cast<uint32_t>(first | Patch::kBothZero << 8 | third << 16 | longest << 24);
    }
  }
};

}  // namespace

Patch::Patch(std::span<const std::array<uint32_t, 3>> in_triangles,
             const std::vector<Vec3i>& positions, size_t expected_slots) {
  triangles_.reserve(expected_slots);
  removers_.reserve(expected_slots);
  removers_.resize(in_triangles.size(), kNone32);
  for (const auto& corners : in_triangles) {
    Triangle& t = triangles_.emplace_back();
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
  const auto n = static_cast<uint32_t>(triangles_.size());
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
  StarShape shape;
  shape.Compute(points, apex);
  const uint32_t code = static_cast<uint32_t>(error_code) << 24;
  triangles_.resize(first + count);
  removers_.resize(first + count, kNone32);
  for (uint32_t j = 0; j < count; ++j) {
    const uint32_t slot = first + j;
    const uint32_t after = j + 1 == k ? 0 : j + 1;
    const uint32_t before = j == 0 ? k - 1 : j - 1;
    const uint32_t o = outer_[j];
    Triangle& t = triangles_[slot];
    t.corners = {vertex, ring_[j], ring_[after]};
    t.opposite = {4 * (first + before) + 2, o, 4 * (first + after)};
    const uint32_t words[3] = {shape.sharpness_word[j] | code, shape.both_word[j],
                               shape.length_word[j]};
    static_assert(offsetof(Triangle, length) == offsetof(Triangle, sharpness) + 8);
    std::memcpy(&t.sharpness, words, sizeof(words));
    if (o == kNone32) continue;
    Triangle& other = triangles_[o >> 2];
    other.opposite[o & 3] = 4 * slot + 1;
    other.both[o & 3] = t.both[1] =
        static_cast<uint8_t>(kBothZero + shape.sharpness[1][j] + other.sharpness[o & 3]);
  }
  if (!boundary) return;
  triangles_[first].opposite[0] = kNone32;
  triangles_[first + count - 1].opposite[2] = kNone32;
  // A split edge's neighbour, if any, is a neighbour no more.
  if (const uint32_t o = outer_[k - 1]; o != kNone32) triangles_[o >> 2].opposite[o & 3] = kNone32;
}

}  // namespace mtdb
