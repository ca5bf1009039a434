// HoleTriangulation: how to fill the polygon that a removed vertex leaves.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "store/base/geometry.h"

namespace mtdb {

// Finds the triangulation of a ring of up to kMaxRing vertices that has the least sum of costs: one
// for each triangle's shape, and the squared error of each diagonal. Points are in the ring's
// frame: z along the normal of the star that is removed, true lengths. Seen along z the ring runs
// counter-clockwise; an open ring (boundary) gets the new edge (k - 1, 0). Fill in what is public,
// call one of the Set functions, then Find. One use at a time; keeps no memory.
class HoleTriangulation {
 public:
  static constexpr uint32_t kMaxRing = 16;
  // k - 2 triangles (i, m, j), i < m < j ring positions. The first holds the edge (0, k - 1); each
  // hangs on an edge (i, j) of one before it.
  using Triangles = std::array<std::array<uint8_t, 3>, kMaxRing>;

  uint32_t k = 0;
  bool boundary = false;
  std::array<Vec3d, kMaxRing> ring;
  // Of the edge (i, j), i < j: diagonals that may not be used, and their errors; negative where an
  // edge cannot be. edge_error[0][k - 1] is the new border edge's.
  std::array<std::array<uint8_t, kMaxRing>, kMaxRing> forbidden;
  std::array<std::array<double, kMaxRing>, kMaxRing> edge_error;

  // Calls f(i, j) for every diagonal that may be used.
  template <typename F>
  void ForEachDiagonal(F&& f) const {
    for (uint32_t i = 0; i + 2 < k; ++i) {
      for (uint32_t j = i + 2; j < k; ++j) {
        if ((i != 0 || j != k - 1) && !forbidden[i][j]) f(i, j);
      }
    }
  }
  // Guesses the diagonals' errors from the points that lie near them. `points` in the frame.
  void GuessEdgeErrors(std::span<const Vec3d> points);
  // The diagonals' exact errors when the star's spokes, from `apex` to the ring, are all that they
  // cross: a diagonal's curve runs over the star in the plane along z. `spoke_error[m]` is what the
  // surface around spoke m has accumulated. Closed rings only. Diagonals that leave the star get
  // kUnknown.
  void MeasureEdgeErrors(Vec3d apex, std::span<const double> spoke_error);
  static constexpr double kUnknown = -2;

  // Costs by shape, times `weight`; triangles that face away from z are not allowed.
  void SetShapeCosts(double weight);
  // Costs by cost(i, m, j).
  template <typename Cost>
  void SetCosts(const Cost& cost) {
    size_t next = 0;
    for (uint32_t span = 2; span < k; ++span) {
      for (uint32_t i = 0; i + span < k; ++i) {
        for (uint32_t m = i + 1; m < i + span; ++m) costs_[next++] = cost(i, m, i + span);
      }
    }
  }
  // Dynamic programming over all triangulations. False when none is allowed.
  bool Find(Triangles& triangles) const;

  // True when p, seen along z, lies right of the line from ring position a to b.
  bool IsRightOf(Vec3d p, uint32_t a, uint32_t b) const { return Side(ring[a], ring[b], p) < 0; }

 private:
  // Twice the area of abp, seen along z: positive when p lies left of ab.
  static double Side(Vec3d a, Vec3d b, Vec3d p) {
    return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x);
  }

  std::array<double, kMaxRing*(kMaxRing - 1) * (kMaxRing - 2) / 6> costs_;
};

}  // namespace mtdb
