// SPDX-License-Identifier: Apache-2.0
#include "codecs/cluster/cluster.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <utility>

namespace mtdb {

namespace {

// Rotates `t` so that its positions read smallest; false when two rotations read alike.
bool RotateCanonically(InTriangle& t) {
  const auto& p = t.positions;
  if (p[0] == p[1] && p[1] == p[2]) return false;
  // A rotation reads smallest when it starts at a least corner; the last of two equal ones.
  size_t first = p[1] < p[0] ? 1 : 0;
  if (p[2] < p[first]) first = 2;
  if (p[first == 0 ? 2 : first - 1] == p[first]) first = first == 0 ? 2 : first - 1;
  const auto rotate = [&](auto& corners) {
    const auto old = corners;
    for (size_t i = 0; i < 3; ++i) corners[i] = old[(first + i) % 3];
  };
  if (first == 0) return true;
  rotate(t.positions);
  rotate(t.vertices);
  rotate(t.parent_vertices);
  return true;
}

struct SortEntry {
  uint64_t key;
  uint32_t triangle;
};

// Sorts by keys below 2^bits; equal ones keep their order.
void RadixSort(std::vector<SortEntry>& entries, int bits) {
  constexpr int kDigit = 11;
  std::vector<SortEntry> other(entries.size());
  for (int shift = 0; shift < bits; shift += kDigit) {
    std::array<uint32_t, (1 << kDigit) + 1> begin{};
    const auto digit = [&](const SortEntry& e) { return e.key >> shift & ((1 << kDigit) - 1); };
    for (const SortEntry& e : entries) ++begin[digit(e) + 1];
    for (size_t d = 1; d < begin.size(); ++d) begin[d] += begin[d - 1];
    for (const SortEntry& e : entries) other[begin[digit(e)]++] = e;
    entries.swap(other);
  }
}

template <typename T>
size_t VectorBytes(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

}  // namespace

bool SortCanonically(std::vector<InTriangle>& triangles) {
  bool unique = true;
  Box3i box;
  for (InTriangle& t : triangles) {
    unique &= RotateCanonically(t);
    box.Add(t.positions[0]);
  }
  // By x and y of the first corner, then by all where these are equal.
  const auto offset = [](int32_t to, int32_t from) {
    return static_cast<uint32_t>(to) - static_cast<uint32_t>(from);
  };
  const int y_bits = triangles.empty() ? 0 : std::bit_width(offset(box.max.y, box.min.y));
  const int x_bits = triangles.empty() ? 0 : std::bit_width(offset(box.max.x, box.min.x));
  std::vector<SortEntry> order(triangles.size());
  for (uint32_t i = 0; i < order.size(); ++i) {
    const Vec3i p = triangles[i].positions[0];
    order[i] = {uint64_t{offset(p.x, box.min.x)} << y_bits | offset(p.y, box.min.y), i};
  }
  RadixSort(order, x_bits + y_bits);
  for (size_t begin = 0; begin < order.size();) {
    size_t end = begin + 1;
    while (end < order.size() && order[end].key == order[begin].key) ++end;
    if (end - begin > 1) {
      std::stable_sort(order.begin() + static_cast<std::ptrdiff_t>(begin),
                       order.begin() + static_cast<std::ptrdiff_t>(end),
                       [&](const SortEntry& a, const SortEntry& b) {
                         return triangles[a.triangle].positions < triangles[b.triangle].positions;
                       });
    }
    begin = end;
  }
  std::vector<InTriangle> sorted;
  sorted.reserve(triangles.size());
  for (const SortEntry& e : order) {
    const InTriangle& t = triangles[e.triangle];
    unique &= sorted.empty() || sorted.back().positions != t.positions;
    sorted.push_back(t);
  }
  triangles = std::move(sorted);
  return unique;
}

size_t Cluster::memory_bytes() const {
  return sizeof(*this) + VectorBytes(in.triangles) + VectorBytes(in.positions) +
         VectorBytes(in.vertices) + VectorBytes(in.rows) + VectorBytes(error_codes) +
         VectorBytes(ring_begin) + VectorBytes(ring_vertices) + VectorBytes(star_begin) +
         VectorBytes(hole_begin) + VectorBytes(hole_slots) + VectorBytes(removers) +
         VectorBytes(children) + VectorBytes(explicit_arcs) + VectorBytes(vertex_begin) +
         VectorBytes(created_corners);
}

}  // namespace mtdb
