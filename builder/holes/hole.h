// SPDX-License-Identifier: Apache-2.0
// Hole: the polygon that a vertex leaves when it is removed, as a filling rule and an error measure
// see it; Filling: the triangles that are put there, and their errors.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// Ring positions 0 .. k - 1 run counter-clockwise. The ring of a vertex on the surface's border is
// open: filling it makes the new border edge (k - 1, 0).
struct Hole {
  static constexpr uint32_t kMaxRing = 16;
  // k - 2 triangles (i, m, j), i < m < j ring positions. The first holds the edge (0, k - 1); each
  // other one hangs on the edge (i, j) of one before it.
  using Triangle = std::array<uint8_t, 3>;
  using Triangles = std::array<Triangle, kMaxRing>;
  template <typename T>
  using PerEdge = std::array<std::array<T, kMaxRing>, kMaxRing>;

  // Set by TileMesh::OpenHole. Vertices, triangles and half-edges are the tile's local ones.
  uint32_t vertex = 0;  // that goes
  uint32_t k = 0;
  bool boundary = false;
  std::vector<uint32_t> ring, star;
  std::vector<uint32_t> ring_edges;       // half-edge of the star from ring[j] to ring[j + 1]
  uint32_t border_out = kNone32;          // of a border vertex: half-edge to ring[0] ...
  uint32_t border_in = kNone32;           // ... and from ring[k - 1]
  Vec3d apex;                             // the vertex, in work units
  std::array<Vec3d, kMaxRing> positions;  // the ring, likewise
  // Of a height field, which is seen along z: shapes are those of what is seen, without heights.
  bool flat = false;
  // Set by TileMesh::ForbidEdges: diagonals (i, j), in both orders, that no filling may use.
  PerEdge<uint8_t> forbidden;

  // Set by the error measure, which looks at the hole along a direction.
  Vec3d normal;                        // unit
  double area = 0;                     // twice the star's, seen along `normal`
  std::array<Vec3d, kMaxRing> points;  // the ring in the hole's frame: z along `normal`
  bool folded = false;                 // not seen whole: projections mean nothing
  // Of the edge (i, j), i < j; negative where there can be none. edge_error[0][k - 1] is the new
  // border edge's.
  PerEdge<double> edge_error;
  // The two ends of side c of a triangle, in its orientation.
  static std::pair<uint32_t, uint32_t> Edge(const Triangle& t, uint32_t c) {
    return {t[c], t[c == 2 ? 0 : c + 1]};
  }
  // True when the edge from a to b is an edge of the ring; else it is the new border edge or a
  // diagonal.
  bool OnRing(uint32_t a, uint32_t b) const {
    return b == a + 1 || (!boundary && a == k - 1 && b == 0);
  }
  bool IsNewBorder(uint32_t a, uint32_t b) const { return boundary && a == k - 1 && b == 0; }
  // Calls f(i, j) for every diagonal that may be used, i < j.
  template <typename F>
  void ForEachDiagonal(F&& f) const {
    for (uint32_t i = 0; i + 2 < k; ++i) {
      for (uint32_t j = i + 2; j < k; ++j) {
        if ((i != 0 || j != k - 1) && !forbidden[i][j]) f(i, j);
      }
    }
  }

  // Sets what depends on the direction: normal, area, frame and points.
  void LookAlong(Vec3d unit_normal, double twice_area) {
    normal = unit_normal;
    area = twice_area;
    for (uint32_t i = 0; flat && i < k; ++i) points[i] = InFrame(positions[i]);
    if (flat) return;
    const Vec3d across = std::abs(normal.x) < 0.6 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
    const Vec3d y = Cross(normal, across);
    e2_ = y * (1 / Length(y));
    e1_ = Cross(e2_, normal);
    for (uint32_t i = 0; i < k; ++i) points[i] = InFrame(positions[i]);
  }
  Vec3d InFrame(Vec3d position) const {
    const Vec3d p = position - positions[0];
    if (flat) return p;
    return {Dot(p, e1_), Dot(p, e2_), Dot(p, normal)};
  }
  // Twice the area of abp, seen along z: positive when p lies left of ab.
  static double Side(Vec3d a, Vec3d b, Vec3d p) {
    return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
  }
  // True when p, in the frame, lies right of the line from ring position a to b, seen along z.
  bool IsRightOf(Vec3d p, uint32_t a, uint32_t b) const {
    return Side(points[a], points[b], p) < 0;
  }

 private:
  Vec3d e1_, e2_;
};

struct Filling {
  // Whether it is made of these, in a hole of k ring vertices.
  bool IsOf(const Hole::Triangles& others, uint32_t k) const {
    return std::equal(triangles.begin(), triangles.begin() + (k - 2), others.begin());
  }

  Hole::Triangles triangles;
  std::array<double, Hole::kMaxRing> errors;  // of the triangles, work units
  double error = 0;                           // the largest of them
};

}  // namespace mtdb::internal
