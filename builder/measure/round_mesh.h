// SPDX-License-Identifier: Apache-2.0
// RoundMesh: a height field against which the heights of later triangles are measured.
//
// A current edge runs above or below a path on the surface, its curve, that crosses the surface's
// edges. The difference in height between the two is linear between crossings, so that it is
// largest at one of them. Each crossing also carries the error that the surface's triangles around
// it have accumulated in earlier rounds.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb::internal {

class RoundMesh {
 public:
  static constexpr int kMaxSteps = 256;  // of a curve; longer ones are not worth their error

  // Half-edge 3 * triangle + i leaves corner i; `opposites`: see PairHalfEdges. `positions` in work
  // units; `errors` accumulated per triangle. Copies what it needs.
  void Build(std::span<const std::array<uint32_t, 3>> triangles,
             std::span<const uint32_t> opposites, std::span<const Vec3d> positions,
             std::span<const float> errors);

  // The largest difference in height between an edge and the surface, seen along z, with what was
  // accumulated. Negative when the path from one end to the other leaves the surface, meets a
  // triangle that does not face up, or is too long. Cost: one step per edge crossed.
  double CurveError(uint32_t a, uint32_t b) const;

 private:
  // Walks are short and go anywhere: what a step reads of a triangle lies together.
  struct alignas(32) Triangle {
    std::array<uint32_t, 3> corners;
    std::array<uint32_t, 3> opposites;  // half-edges; kNone32 at the tile's rim
    float error;
  };
  // A triangle at a vertex: the half-edge that leaves the vertex, and its other corners in order.
  struct Spoke {
    uint32_t half_edge, right, left;
  };

  uint32_t origin(uint32_t h) const { return triangles_[h / 3].corners[h % 3]; }
  uint32_t opposite(uint32_t h) const { return triangles_[h / 3].opposites[h % 3]; }
  std::span<const Spoke> spokes(uint32_t vertex) const {
    return std::span(spokes_).subspan(spokes_begin_[vertex],
                                      spokes_begin_[vertex + 1] - spokes_begin_[vertex]);
  }
  // Where a path leaves a vertex: between p on its right and q on its left.
  struct Start {
    uint32_t across = kNone32;  // half-edge from p to q
    Vec3d p, q;
    double side_p = 0, side_q = 0;
  };
  bool FindStart(uint32_t a, Vec3d right, Start* start) const;

  std::vector<Triangle> triangles_;
  std::vector<Vec3d> positions_;
  std::vector<uint32_t> spokes_begin_;
  std::vector<Spoke> spokes_;
};

}  // namespace mtdb::internal
