#include "codecs/internal/patch.h"

#include <algorithm>
#include <bit>

#include "store/base/hash.h"

namespace mtdb {

Patch::Patch(std::span<const std::array<uint32_t, 3>> in_triangles, size_t expected_slots) {
  const size_t n = in_triangles.size();
  origin_.reserve(3 * expected_slots);
  opposite_.reserve(3 * expected_slots);
  removers_.reserve(expected_slots);
  for (const auto& t : in_triangles) origin_.insert(origin_.end(), t.begin(), t.end());
  opposite_.assign(3 * n, kNone32);
  removers_.assign(n, kNone32);

  // Pairs each directed edge with its reverse. An edge that occurs twice in one direction is
  // non-manifold: it pairs with nothing.
  const size_t capacity = std::bit_ceil(6 * n + 2);
  struct Entry {
    uint64_t edge = ~0ull;
    uint32_t half_edge = kNone32;
    bool repeated = false;
  };
  std::vector<Entry> table(capacity);
  const auto find = [&](uint64_t edge) -> Entry& {
    size_t i = Mix64(edge) & (capacity - 1);
    while (table[i].edge != ~0ull && table[i].edge != edge) i = (i + 1) & (capacity - 1);
    return table[i];
  };
  const auto edge_of = [&](uint32_t h) {
    return (static_cast<uint64_t>(origin_[h]) << 32) | origin_[Next(h)];
  };
  for (uint32_t h = 0; h < 3 * n; ++h) {
    Entry& e = find(edge_of(h));
    e.repeated |= e.half_edge != kNone32;
    e.edge = edge_of(h);
    e.half_edge = h;
  }
  for (uint32_t h = 0; h < 3 * n; ++h) {
    const uint64_t edge = edge_of(h);
    const Entry& e = find(edge);
    const Entry& twin = find((edge << 32) | (edge >> 32));
    if (!e.repeated && twin.half_edge != kNone32 && !twin.repeated) opposite_[h] = twin.half_edge;
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
  removers_.resize(first + count, kNone32);
  origin_.resize(3 * (first + count));
  opposite_.resize(3 * (first + count), kNone32);
  for (uint32_t j = 0; j < count; ++j) {
    const uint32_t h = 3 * (first + j);
    origin_[h] = vertex;
    origin_[h + 1] = ring_[j];
    origin_[h + 2] = ring_[j + 1 == k ? 0 : j + 1];
    Link(h + 1, outer_[j]);
    if (j > 0) Link(h, 3 * (first + j - 1) + 2);
  }
  if (boundary) {
    // The split edge's neighbour, if any, is a neighbour no more.
    if (outer_[k - 1] != kNone32) opposite_[outer_[k - 1]] = kNone32;
  } else {
    Link(3 * first, 3 * (first + count - 1) + 2);
  }
}

}  // namespace mtdb
