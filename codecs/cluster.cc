#include "codecs/cluster.h"

#include <algorithm>
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

// Ascending with positions, but for z.
uint64_t SortKey(Vec3i p) {
  constexpr uint32_t kSign = 0x80000000u;
  return static_cast<uint64_t>(static_cast<uint32_t>(p.x) ^ kSign) << 32 |
         (static_cast<uint32_t>(p.y) ^ kSign);
}

template <typename T>
size_t VectorBytes(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

}  // namespace

bool SortCanonically(std::vector<InTriangle>& triangles) {
  bool unique = true;
  for (InTriangle& t : triangles) unique &= RotateCanonically(t);
  struct Entry {
    uint64_t key;
    uint32_t triangle;
  };
  std::vector<Entry> order(triangles.size());
  for (uint32_t i = 0; i < order.size(); ++i) order[i] = {SortKey(triangles[i].positions[0]), i};
  std::sort(order.begin(), order.end(), [&](const Entry& a, const Entry& b) {
    if (a.key != b.key) return a.key < b.key;
    const auto c = triangles[a.triangle].positions <=> triangles[b.triangle].positions;
    return c == 0 ? a.triangle < b.triangle : c < 0;
  });
  std::vector<InTriangle> sorted;
  sorted.reserve(triangles.size());
  for (const Entry& e : order) sorted.push_back(triangles[e.triangle]);
  triangles = std::move(sorted);
  for (size_t i = 1; i < triangles.size(); ++i) {
    unique &= triangles[i - 1].positions != triangles[i].positions;
  }
  return unique;
}

size_t Cluster::memory_bytes() const {
  return sizeof(*this) + VectorBytes(in.triangles) + VectorBytes(in.positions) +
         VectorBytes(in.vertices) + VectorBytes(in.rows) + VectorBytes(error_codes) +
         VectorBytes(ring_begin) + VectorBytes(ring_vertices) + VectorBytes(star_begin) +
         VectorBytes(hole_begin) + VectorBytes(hole_slots) + VectorBytes(removers) +
         VectorBytes(children) + VectorBytes(explicit_arcs);
}

size_t RootPiece::memory_bytes() const {
  return sizeof(*this) + VectorBytes(triangles) + VectorBytes(positions) + VectorBytes(vertices) +
         VectorBytes(rows) + VectorBytes(removers) + VectorBytes(children) +
         VectorBytes(explicit_arcs);
}

}  // namespace mtdb
