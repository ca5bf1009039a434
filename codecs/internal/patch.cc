#include "codecs/internal/patch.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "store/base/hash.h"

namespace mtdb {

int Exponent(double x) {
  const int biased = static_cast<int>(std::bit_cast<uint64_t>(x) >> 52 & 0x7ff);
  return biased < 1023 ? 0 : biased - 1023;
}

Patch::Patch(std::span<const std::array<uint32_t, 3>> in_triangles,
             const std::vector<Vec3d>& points, size_t expected_slots)
    : points_(points) {
  triangles_.reserve(expected_slots);
  for (const auto& corners : in_triangles) {
    Triangle& t = triangles_.emplace_back();
    t.corners = corners;
    t.opposite = {kNone32, kNone32, kNone32};
    t.remover = kNone32;
    std::array<double, 3> squared;
    for (size_t i = 0; i < 3; ++i) {
      squared[i] = SquaredLength(points_[corners[i == 2 ? 0 : i + 1]] - points_[corners[i]]);
    }
    SetShape(t, squared);
  }
  PairEdges();
}

// Pairs each directed edge with its reverse. An edge that occurs twice in one direction is
// non-manifold: it pairs with nothing.
void Patch::PairEdges() {
  const auto n = static_cast<uint32_t>(triangles_.size());
  struct Entry {
    uint64_t edge = ~0ull;
    uint32_t half_edge = kNone32;
    bool repeated = false;
  };
  const size_t capacity = std::bit_ceil(6 * size_t{n} + 2);
  std::vector<Entry> table(capacity);
  const auto find = [&](uint64_t edge) -> Entry& {
    size_t i = Mix64(edge) & (capacity - 1);
    while (table[i].edge != ~0ull && table[i].edge != edge) i = (i + 1) & (capacity - 1);
    return table[i];
  };
  const auto edge_of = [&](uint32_t slot, size_t i) {
    const auto& c = triangles_[slot].corners;
    return (static_cast<uint64_t>(c[i]) << 32) | c[i == 2 ? 0 : i + 1];
  };
  for (uint32_t slot = 0; slot < n; ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      Entry& e = find(edge_of(slot, i));
      e.repeated |= e.half_edge != kNone32;
      e.edge = edge_of(slot, i);
      e.half_edge = 4 * slot + i;
    }
  }
  for (uint32_t slot = 0; slot < n; ++slot) {
    for (uint32_t i = 0; i < 3; ++i) {
      const uint64_t edge = edge_of(slot, i);
      const Entry& twin = find((edge << 32) | (edge >> 32));
      if (twin.half_edge == kNone32 || twin.repeated || find(edge).repeated) continue;
      triangles_[slot].opposite[i] = twin.half_edge;
    }
  }
}

void Patch::SetShape(Triangle& t, const std::array<double, 3>& squared) {
  const double sum = squared[0] + squared[1] - squared[2];
  const double area = std::sqrt(std::max(4 * squared[0] * squared[1] - sum * sum, 1.0));
  const double scale = 8 / area;  // `area` is four times the triangle's
  for (size_t i = 0; i < 3; ++i) {
    const double others = squared[(i + 1) % 3] + squared[(i + 2) % 3] - squared[i];
    const double cotangent = std::min<double>(kMaxCotangent, others * scale);
    t.cotangent[i] = static_cast<int8_t>(std::floor(std::max<double>(-kMaxCotangent, cotangent)));
    t.length[i] = static_cast<uint8_t>(Exponent(squared[i]));
  }
}

void Patch::RotateRing(size_t split) {
  const auto middle = static_cast<std::ptrdiff_t>((split + 1) % ring_.size());
  std::rotate(ring_.begin(), ring_.begin() + middle, ring_.end());
  std::rotate(outer_.begin(), outer_.begin() + middle, outer_.end());
}

void Patch::InsertStar(uint32_t vertex, bool boundary) {
  const auto k = static_cast<uint32_t>(ring_.size());
  const uint32_t count = boundary ? k - 1 : k;
  const uint32_t first = slots();
  const Vec3d apex = points_[vertex];
  spokes_.resize(k);
  for (uint32_t j = 0; j < k; ++j) spokes_[j] = SquaredLength(points_[ring_[j]] - apex);
  triangles_.resize(first + count);
  for (uint32_t j = 0; j < count; ++j) {
    const uint32_t after = j + 1 == k ? 0 : j + 1;
    Triangle& t = triangles_[first + j];
    t.corners = {vertex, ring_[j], ring_[after]};
    t.remover = kNone32;
    t.opposite = {4 * (first + j - 1) + 2, kNone32, 4 * (first + j + 1)};
    const double edge = SquaredLength(points_[ring_[after]] - points_[ring_[j]]);
    SetShape(t, {spokes_[j], edge, spokes_[after]});
    Link(4 * (first + j) + 1, outer_[j]);
  }
  triangles_[first].opposite[0] = boundary ? kNone32 : 4 * (first + count - 1) + 2;
  triangles_[first + count - 1].opposite[2] = boundary ? kNone32 : 4 * first;
  // A split edge's neighbour, if any, is a neighbour no more.
  if (boundary && outer_[k - 1] != kNone32) Link(outer_[k - 1], kNone32);
}

}  // namespace mtdb
