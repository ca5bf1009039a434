#include "codecs/cluster.h"

#include <algorithm>
#include <tuple>

namespace mtdb {

namespace {

std::tuple<Vec3i, Vec3i, Vec3i> SortKey(const InTriangle& t) {
  return {t.positions[0], t.positions[1], t.positions[2]};
}

// Rotates `t` so that its positions read smallest; false when two rotations read alike.
bool RotateCanonically(InTriangle& t) {
  const auto& p = t.positions;
  int first = 0;
  for (int r = 1; r < 3; ++r) {
    const auto key = [&](int i) {
      return std::tuple(p[static_cast<size_t>(i)], p[static_cast<size_t>((i + 1) % 3)],
                        p[static_cast<size_t>((i + 2) % 3)]);
    };
    if (key(r) < key(first)) first = r;
  }
  std::rotate(t.positions.begin(), t.positions.begin() + first, t.positions.end());
  std::rotate(t.vertices.begin(), t.vertices.begin() + first, t.vertices.end());
  std::rotate(t.parent_vertices.begin(), t.parent_vertices.begin() + first,
              t.parent_vertices.end());
  return !(t.positions[0] == t.positions[1] && t.positions[1] == t.positions[2]);
}

template <typename T>
size_t VectorBytes(const std::vector<T>& v) {
  return v.capacity() * sizeof(T);
}

}  // namespace

bool SortCanonically(std::vector<InTriangle>& triangles) {
  bool unique = true;
  for (InTriangle& t : triangles) unique &= RotateCanonically(t);
  std::stable_sort(
      triangles.begin(), triangles.end(),
      [](const InTriangle& a, const InTriangle& b) { return SortKey(a) < SortKey(b); });
  for (size_t i = 1; i < triangles.size(); ++i) {
    unique &= SortKey(triangles[i - 1]) != SortKey(triangles[i]);
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
