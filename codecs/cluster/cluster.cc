// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/cluster.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <utility>

#include "store/base/check.h"

namespace mtdb {

namespace {

// Sorts items by bucket(item), which is less than `buckets`; those of one bucket keep their order.
// Returns where the buckets end. `other` is as long, to work with.
template <typename T, typename Bucket>
std::vector<uint32_t> SortByBucket(std::vector<T>& items, std::vector<T>& other, size_t buckets,
                                   Bucket&& bucket) {
  std::vector<uint32_t> begin(buckets + 1);
  for (const T& item : items) ++begin[bucket(item) + 1];
  for (size_t b = 1; b <= buckets; ++b) begin[b] += begin[b - 1];
  for (const T& item : items) other[begin[bucket(item)]++] = item;
  items.swap(other);
  return begin;
}

// Few items, or many.
template <typename T, typename Less>
void SortFew(std::span<T> items, Less&& less) {
  constexpr size_t kFew = 8;
  if (items.size() > kFew) {
    std::sort(items.begin(), items.end(), less);
    return;
  }
  for (size_t i = 1; i < items.size(); ++i) {
    const T item = items[i];
    size_t j = i;
    for (; j > 0 && less(item, items[j - 1]); --j) items[j] = items[j - 1];
    items[j] = item;
  }
}

// How many positions precede each one, but for equal ones, in ascending order.
std::vector<uint32_t> RankPositions(std::span<const Vec3i> positions) {
  struct Entry {
    uint64_t xy;
    uint32_t z;
    uint32_t vertex;
  };
  // They may differ by more than int32 holds.
  const auto offset = [](int32_t to, int32_t from) {
    return static_cast<uint32_t>(to) - static_cast<uint32_t>(from);
  };
  Box3i box;
  for (const Vec3i& p : positions) box.Add(p);
  std::vector<Entry> entries(positions.size());
  for (uint32_t v = 0; v < entries.size(); ++v) {
    const Vec3i p = positions[v];
    entries[v] = {uint64_t{offset(p.x, box.min.x)} << 32 | offset(p.y, box.min.y),
                  offset(p.z, box.min.z), v};
  }
  // By slices of the box that hold about one vertex each, where they are spread evenly.
  const uint32_t width = entries.empty() ? 0 : offset(box.max.x, box.min.x);
  const int shift = 32 + std::max(0, static_cast<int>(std::bit_width(width)) -
                                         static_cast<int>(std::bit_width(entries.size())));
  std::vector<Entry> other(entries.size());
  const std::vector<uint32_t> ends =
      SortByBucket(entries, other, (size_t{width} >> (shift - 32)) + 1,
                   [&](const Entry& e) { return e.xy >> shift; });
  uint32_t begin = 0;
  for (const uint32_t end : ends) {
    SortFew(std::span(entries).subspan(begin, end - begin),
            [](const Entry& a, const Entry& b) { return a.xy != b.xy ? a.xy < b.xy : a.z < b.z; });
    begin = end;
  }
  std::vector<uint32_t> ranks(positions.size());
  uint32_t rank = 0;
  for (size_t i = 0; i < entries.size(); ++i) {
    const bool equal =
        i > 0 && entries[i].xy == entries[i - 1].xy && entries[i].z == entries[i - 1].z;
    if (!equal) rank = static_cast<uint32_t>(i);
    ranks[entries[i].vertex] = rank;
  }
  return ranks;
}

template <typename T>
size_t VectorBytes(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

}  // namespace

// Most branches on vertices would be hard to predict: there are none in loops over triangles.
CanonicalOrder SortCanonically(std::span<const std::array<uint32_t, 3>> triangles,
                               std::span<const Vec3i> positions) {
  constexpr int kRankBits = 21;
  constexpr uint64_t kRankMask = (1 << kRankBits) - 1;
  MTDB_CHECK(positions.size() <= kRankMask, "more vertices than a cluster may have");
  const std::vector<uint32_t> ranks = RankPositions(positions);
  struct Entry {
    uint64_t key;  // the corners' ranks
    InSlot slot;
  };
  CanonicalOrder order;
  std::vector<Entry> entries(triangles.size());
  for (uint32_t i = 0; i < entries.size(); ++i) {
    const auto& corners = triangles[i];
    const uint64_t a = ranks[corners[0]];
    const uint64_t b = ranks[corners[1]];
    const uint64_t c = ranks[corners[2]];
    uint64_t key = a << 2 * kRankBits | b << kRankBits | c;
    const uint64_t from_b = b << 2 * kRankBits | c << kRankBits | a;
    const uint64_t from_c = c << 2 * kRankBits | a << kRankBits | b;
    const uint32_t starts_at_b = from_b < key ? 1 : 0;
    key ^= (key ^ from_b) & (0 - uint64_t{starts_at_b});
    const uint32_t starts_at_c = from_c < key ? 1 : 0;
    key ^= (key ^ from_c) & (0 - uint64_t{starts_at_c});
    const uint32_t first = 2 * starts_at_c + (starts_at_b & ~starts_at_c);
    entries[i] = {key, {i, first}};
    order.unique &= (a != b) | (b != c);
  }
  std::vector<Entry> other(entries.size());
  for (const int shift : {0, kRankBits, 2 * kRankBits}) {
    SortByBucket(entries, other, positions.size(),
                 [&](const Entry& e) { return e.key >> shift & kRankMask; });
  }
  order.slots.resize(entries.size());
  for (size_t i = 0; i < entries.size(); ++i) {
    order.slots[i] = entries[i].slot;
    order.unique &= i == 0 || entries[i].key != entries[i - 1].key;
  }
  return order;
}

InPatch MakeInPatch(std::span<const std::array<uint32_t, 3>> triangles,
                    std::span<const Vec3i> positions, std::span<const InSlot> slots) {
  InPatch patch;
  patch.triangles.resize(slots.size());
  patch.vertices.resize(positions.size() + 1);
  std::vector<uint32_t> numbers(positions.size(), kNone32);
  uint32_t count = 0;
  for (size_t s = 0; s < slots.size(); ++s) {
    uint32_t from = slots[s].first_corner;
    for (uint32_t& corner : patch.triangles[s]) {
      const uint32_t vertex = triangles[slots[s].triangle][from];
      const uint32_t is_new = numbers[vertex] == kNone32 ? 1 : 0;
      corner = numbers[vertex] += is_new * (count + 1);  // kNone32 becomes count
      patch.vertices[count] = vertex;
      count += is_new;
      from = from == 2 ? 0 : from + 1;
    }
  }
  patch.vertices.resize(count);
  patch.positions.reserve(count);
  for (const VertexIndex vertex : patch.vertices) patch.positions.push_back(positions[vertex]);
  return patch;
}

size_t Cluster::memory_bytes() const {
  return sizeof(*this) + VectorBytes(in.triangles) + VectorBytes(in.positions) +
         VectorBytes(in.vertices) + VectorBytes(in.rows) + VectorBytes(error_codes) +
         VectorBytes(ring_begin) + VectorBytes(ring_vertices) + VectorBytes(star_begin) +
         VectorBytes(hole_begin) + VectorBytes(hole_slots) + VectorBytes(removers) +
         VectorBytes(children) + VectorBytes(explicit_arcs) + VectorBytes(vertex_begin) +
         VectorBytes(created_corners) + VectorBytes(fans) + VectorBytes(later_fans) +
         VectorBytes(in.two_sided) + VectorBytes(in.corners) + VectorBytes(in.corner_places) +
         VectorBytes(in.seams);
}

}  // namespace mtdb
