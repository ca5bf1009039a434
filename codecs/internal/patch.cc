#include "codecs/internal/patch.h"

#include <algorithm>
#include <bit>

#include "store/base/hash.h"

namespace mtdb {

namespace {

// `facing`, `b` and `c` are squared lengths of a triangle's edges; the sharpness of the corner that
// the first of them faces. The fraction lies in [0, 2], since the square of a sum is at most twice
// the sum of the squares.
inline int32_t Sharpness(float facing, float b, float c) {
  return 64 - static_cast<int32_t>(64 * facing / (b + c + 1e-30f));
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

// The shapes of a star's triangles, four at a time. Squared lengths: spoke[j] of the edge to ring
// vertex j, edge[j] of ring edge j; the ends are padded.
struct StarShape {
  static constexpr size_t kSize = kMaxRing + 8;
  float spoke[kSize], edge[kSize];
  int32_t sharpness[3][kSize], spoke_length[kSize], edge_length[kSize];

  void Compute(uint32_t count) {
    for (uint32_t j = 0; j < (count + 3) / 4 * 4; ++j) {
      sharpness[0][j] = Sharpness(spoke[j], edge[j], spoke[j + 1]);
      sharpness[1][j] = Sharpness(edge[j], spoke[j + 1], spoke[j]);
      sharpness[2][j] = Sharpness(spoke[j + 1], spoke[j], edge[j]);
      edge_length[j] = Exponent(edge[j]);
    }
    for (uint32_t j = 0; j < (count + 4) / 4 * 4; ++j) spoke_length[j] = Exponent(spoke[j]);
  }
};

}  // namespace

Patch::Patch(std::span<const std::array<uint32_t, 3>> in_triangles,
             const std::vector<Vec3i>& positions, size_t expected_slots)
    : positions_(positions) {
  triangles_.reserve(expected_slots);
  for (const auto& corners : in_triangles) {
    Triangle& t = triangles_.emplace_back();
    t.corners = corners;
    t.opposite = {kNone32, kNone32, kNone32};
    t.remover = kNone32;
    const Vec3d a = point(corners[0]);
    const Vec3d b = point(corners[1]);
    const Vec3d c = point(corners[2]);
    SetShape(t, static_cast<float>(SquaredLength(b - a)), static_cast<float>(SquaredLength(c - b)),
             static_cast<float>(SquaredLength(a - c)));
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
        Link(e.half_edge, 4 * slot + i);
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

void Patch::InsertStar(uint32_t vertex, bool boundary, uint8_t error_code) {
  const uint32_t k = ring_count_;
  const uint32_t count = boundary ? k - 1 : k;
  const uint32_t first = slots();
  const Vec3d apex = point(vertex);
  StarShape shape;
  Vec3d last = point(ring_[k - 1]);
  for (uint32_t j = 0; j < k; ++j) {
    const Vec3d p = point(ring_[j]);
    shape.spoke[j] = static_cast<float>(SquaredLength(p - apex));
    shape.edge[j == 0 ? k - 1 : j - 1] = static_cast<float>(SquaredLength(p - last));
    last = p;
  }
  shape.spoke[k] = shape.spoke[0];
  for (uint32_t j = k; j < k + 4; ++j) shape.spoke[j + 1] = shape.edge[j] = 0;
  shape.Compute(k);
  triangles_.resize(first + count);
  for (uint32_t j = 0; j < count; ++j) {
    const uint32_t slot = first + j;
    Triangle& t = triangles_[slot];
    t.corners = {vertex, ring_[j], ring_[j + 1 == k ? 0 : j + 1]};
    t.opposite = {4 * (slot - 1) + 2, outer_[j], 4 * (slot + 1)};
    t.remover = kNone32;
    const auto a = static_cast<uint8_t>(shape.spoke_length[j]);
    const auto b = static_cast<uint8_t>(shape.edge_length[j]);
    const auto c = static_cast<uint8_t>(shape.spoke_length[j + 1 == k ? 0 : j + 1]);
    for (size_t i = 0; i < 3; ++i) t.sharpness[i] = static_cast<int8_t>(shape.sharpness[i][j]);
    t.length = {a, b, c};
    t.longest = std::max(std::max(a, b), c);
    t.error_code = error_code;
    if (outer_[j] != kNone32) triangles_[outer_[j] >> 2].opposite[outer_[j] & 3] = 4 * slot + 1;
  }
  triangles_[first].opposite[0] = boundary ? kNone32 : 4 * (first + count - 1) + 2;
  triangles_[first + count - 1].opposite[2] = boundary ? kNone32 : 4 * first;
  // A split edge's neighbour, if any, is a neighbour no more.
  if (boundary && outer_[k - 1] != kNone32) Link(outer_[k - 1], kNone32);
}

}  // namespace mtdb
