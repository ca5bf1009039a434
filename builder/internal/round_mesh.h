// SPDX-License-Identifier: Apache-2.0
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
#include "store/object_record.h"

namespace mtdb::internal {

// Vertices that were marked with a number.
struct VertexMarks {
  std::span<const uint32_t> marks;
  uint32_t mark = 0;
  bool operator()(uint32_t vertex) const { return !marks.empty() && marks[vertex] == mark; }
};

class RoundMesh {
 public:
  static constexpr int kMaxSteps = 256;  // of a curve; longer ones are not worth their error

  // Half-edge 3 * triangle + i leaves corner i; `opposites`: see PairHalfEdges. `positions` in work
  // units; `errors` accumulated per triangle. Copies what it needs.
  void Build(std::span<const std::array<uint32_t, 3>> triangles,
             std::span<const uint32_t> opposites, std::span<const Vec3d> positions,
             std::span<const float> errors);

  uint32_t triangle_count() const { return static_cast<uint32_t>(triangles_.size()); }
  // Largest accumulated error around a vertex.
  double vertex_error(uint32_t vertex) const { return vertices_[vertex].error; }
  // How far a vertex stands off the mean of its neighbours, along the mean normal.
  double Height(uint32_t vertex) const;
  // True when every input triangle at `vertex` faces the unit vector `n`.
  bool Faces(uint32_t vertex, Vec3d n) const;

  // The curve of an edge: the path from one end to the other in the plane through both that
  // contains a direction n, seen along n.
  struct Curve {
    double error = -1;  // of its distance to the edge, with what was accumulated; negative: no path
    double reach = 0;   // bound on the distance alone
  };
  // `error` is negative when there is no such path within the tile, or it meets a triangle turned
  // away from n, or it may run on another sheet of the surface than the one meant: where several
  // triangles at an end lie one over the other, the one meant has a corner that `is_near` says is
  // meant. Cost: one step per input edge crossed. Of the vertical measure n is (0, 0, 1), and the
  // distance that of heights.
  template <ErrorMeasure kKind = ErrorMeasure::kTwoSidedDistance>
  Curve CurveOf(uint32_t a, uint32_t b, Vec3d n, const VertexMarks& is_near = {}) const;

 private:
  // Walks are short and go anywhere: what a step reads of a triangle or a vertex lies together.
  struct alignas(32) Triangle {
    std::array<uint32_t, 3> corners;
    std::array<uint32_t, 3> opposites;  // half-edges; kNone32 at the tile's rim
    float error;
  };
  struct alignas(32) Vertex {
    Vec3d position;
    double error;  // the largest of its triangles'
  };
  // A triangle at a vertex: the half-edge that leaves the vertex, and its other corners in order.
  struct Spoke {
    uint32_t half_edge, right, left;
  };
  struct Cone {
    Vec3d axis;
    double sine = 2;    // of the widest angle between the axis and a triangle's normal; 2: over 90
    bool once = false;  // the triangles go around the vertex once, seen along any n in the cone
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
    bool only = false;  // nothing else of the surface lies there
  };
  bool FindStart(uint32_t a, Vec3d right, Vec3d n, const VertexMarks& is_near, Start* start) const;
  // Whether a direction leaves a vertex through one triangle, wherever it goes, seen along n.
  bool IsOnce(uint32_t vertex, Vec3d n) const {
    return cones_[vertex].once && Dot(cones_[vertex].axis, n) > cones_[vertex].sine;
  }
  bool GoesAroundOnce(uint32_t vertex) const;
  Vec3d Normal(uint32_t t) const;
  void SortFans();
  void MeasureVertices();

  std::vector<Triangle> triangles_;
  std::vector<Vertex> vertices_;
  std::vector<uint32_t> spokes_begin_;
  std::vector<Spoke> spokes_;
  std::vector<Cone> cones_;  // of the vertices
};

}  // namespace mtdb::internal
