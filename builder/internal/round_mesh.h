// RoundMesh: a tile's input surface, against which the error of every later triangle is measured.
//
// A current edge stands for a curve on the input surface: a path from one end to the other that
// crosses input edges. The distance of a point of the path to the edge is convex between
// crossings, so that its maximum lies at a crossing. The curves of a triangle's three edges bound
// the patch of the input that the triangle stands for; the patch's pieces are convex polygons whose
// corners are crossings, the triangle's corners, or removed vertices. So the two-sided distance
// between triangle and patch (continuous map of degree one, convexity of the distance to a convex
// set) is at most the largest distance at those points. Each sample also carries the error that the
// input triangles around it have accumulated in earlier rounds.
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
  // Half-edge 3 * triangle + i leaves corner i; `opposites`: see PairHalfEdges. `positions` in work
  // units; `errors` accumulated per triangle. Copies what it needs.
  void Build(std::span<const std::array<uint32_t, 3>> triangles,
             std::span<const uint32_t> opposites, std::span<const Vec3d> positions,
             std::span<const float> errors);

  uint32_t triangle_count() const { return static_cast<uint32_t>(errors_.size()); }
  std::span<const uint32_t> half_edges_from(uint32_t vertex) const {
    return std::span(outgoing_).subspan(outgoing_begin_[vertex],
                                        outgoing_begin_[vertex + 1] - outgoing_begin_[vertex]);
  }
  // Largest accumulated error around a vertex.
  double vertex_error(uint32_t vertex) const { return vertex_errors_[vertex]; }
  // How far a vertex stands off the mean of its neighbours, along the mean normal.
  double Height(uint32_t vertex) const;
  // True when every input triangle at `vertex` faces the unit vector `n`.
  bool Faces(uint32_t vertex, Vec3d n) const;

  // Bound on the distance between the segment ab and its curve: the path from a to b in the plane
  // through both that contains `n`, seen along `n`. Negative when there is no such path within the
  // tile, or it meets a triangle turned away from n. Cost: one step per input edge crossed.
  double CurveError(uint32_t a, uint32_t b, Vec3d n) const;

 private:
  void SortFans();
  void MeasureVertices();

  std::vector<uint32_t> origin_;    // per half-edge
  std::vector<uint32_t> opposite_;  // per half-edge, kNone32 at the tile's rim
  std::vector<Vec3d> positions_;    // per vertex
  std::vector<Vec3d> normals_;      // per triangle, not normalised
  std::vector<float> errors_;       // per triangle
  std::vector<uint32_t> outgoing_begin_, outgoing_;
  std::vector<double> vertex_errors_;
  struct Cone {
    Vec3d axis;
    double sine = 2;  // of the widest angle between the axis and a triangle's normal; 2: over 90
  };
  std::vector<Cone> cones_;
};

}  // namespace mtdb::internal
