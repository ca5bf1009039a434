// SPDX-License-Identifier: Apache-2.0
// SurfaceMap: a map of the surface S that errors are measured against onto the tile's mesh, which
// follows the mesh as it changes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/disk/tile.h"
#include "builder/holes/hole.h"
#include "builder/holes/tile_mesh.h"
#include "builder/measure/mesh_crossings.h"
#include "builder/measure/surface_edges.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// A vertex of S lies at a vertex of the mesh or, when it is removed, in a triangle of the mesh that
// is named its home, or on an edge of the border. An edge of S then follows a path from the place
// of one end to that of the other, from triangle to triangle; the map keeps which edges of the mesh
// it crosses, one after the other. Where exactly homes and crossings lie is nobody's business:
// docs/design.md, section 3, says what follows for the distance.
//
// Work of one thread.
class SurfaceMap {
 public:
  // Where a part of a path that lies in the star begins or ends: outside of it (0), on an edge of
  // the ring or at a vertex of it (by its position, an edge's is that of its first vertex), or at a
  // sample.
  using End = uint32_t;
  static constexpr End kOutside = 0;
  static constexpr End RingEdge(uint32_t r) { return 1 + r; }
  static constexpr End RingVertex(uint32_t r) { return RingEdge(Hole::kMaxRing) + r; }
  static constexpr End Sample(uint32_t s) { return RingVertex(Hole::kMaxRing) + s; }
  struct Part {
    uint32_t edge = 0;  // of S
    End from = kOutside, to = kOutside;
    uint32_t begin = 0, end = 0;  // its crossings, of the path's
  };
  struct InnerEdge {  // of S, with both ends in the star
    uint32_t edge = 0;
    End from = kOutside, to = kOutside;
  };
  // Which diagonals of a filling lie between an end and the filling's first triangle, a bit for the
  // triangle that hangs on each; and on which of them it lies itself.
  struct Behind {
    uint32_t behind = 0, on = 0;
  };
  // Of the ends in a filling.
  class Masks {
   public:
    // `homes`: of the samples.
    void Set(const Hole& hole, const Hole::Triangles& triangles, std::span<const uint32_t> homes);
    Behind Of(End end) const { return ends_[end]; }

    // The diagonals that lie between two ends.
    uint32_t Between(End a, End b) const {
      const Behind from = ends_[a];
      const Behind to = ends_[b];
      return (from.behind ^ to.behind) & ~(from.on | to.on);
    }

   private:
    std::vector<Behind> ends_;
  };

  // `triangles` and `errors`: of S, whose vertices are the mesh's and others, with these `numbers`
  // in the input; `opposites`: of its half-edges (PairHalfEdges). Every edge follows itself.
  void Build(const TileMesh& mesh, std::span<const std::array<uint32_t, 3>> triangles,
             std::span<const uint32_t> opposites, std::span<const float> errors,
             std::span<const uint32_t> numbers);
  // Of a surface that earlier rounds have moved on; once, after Build.
  void AddChords(std::vector<Chord> chords, const TileMesh& mesh,
                 std::span<const uint32_t> numbers);
  // What the next round needs, of the triangles that are there.
  void Hold(std::span<const uint8_t> alive, std::vector<Chord>& chords) const;

  const SurfaceEdges::Edge& edge(uint32_t e) const { return edges_[e]; }
  // Whether the edge crosses something.
  bool HasPath(uint32_t e) const { return edges_[e].length != 0; }

  // Of a hole: Open, then MarkSample and MarkChain for the vertices of S whose places will change,
  // or which lie on the border edges of the ring; then FindParts. False when a path is not known
  // well enough: the hole must stay.
  void Open(const Hole& hole);
  void MarkSample(uint32_t vertex, uint32_t sample) { Mark(vertex, Sample(sample)); }
  void MarkChain(uint32_t vertex, uint32_t ring_edge) { Mark(vertex, RingEdge(ring_edge)); }
  bool FindParts();
  std::span<const Part> parts() const { return parts_; }
  // Those whose paths cross something are among the parts, and mean nothing here.
  std::span<const InnerEdge> inner_edges() const {
    return std::span(inner_edges_).first(inner_edge_count_);
  }
  // The filling has been put in the mesh, its triangles numbered from `first`.
  void HandOn(const Hole& hole, const Hole::Triangles& triangles, const Masks& masks,
              uint32_t first);

 private:
  static constexpr uint32_t kGap = kNone32;  // in a path: a part of it that is outside the tile

  void JoinChords(uint32_t edge, std::span<const Chord> chords, const TileMesh& mesh);
  void Mark(uint32_t vertex, End end) {
    places_[vertex] = {opened_, end};
    marked_.push_back(vertex);
    edges_.PrefetchAt(vertex);
  }
  End EndOf(uint32_t v) const {
    // No branch, which could not be foretold.
    return places_[v].end & (0u - static_cast<uint32_t>(places_[v].opened == opened_));
  }
  static bool IsInside(End end) {
    return end != kOutside && (end < RingVertex(0) || end >= Sample(0));
  }
  void MarkMeshEdge(uint32_t half_edge, uint8_t code);
  void FindInnerEdges();
  bool FindParts(uint32_t e);
  void Change(uint32_t edge, uint32_t made);
  void Reduce(std::vector<uint32_t>& path) const;

  SurfaceEdges edges_;
  MeshCrossings crossings_;

  // Of the open hole.
  uint32_t opened_ = 0;
  struct Place {  // of a vertex of S, when it was marked in the hole that is open
    uint32_t opened = 0;
    End end = kOutside;
  };
  std::vector<Place> places_;
  std::vector<uint32_t> marked_;
  std::vector<uint32_t> star_edges_;
  std::vector<uint32_t> found_;                   // edges of S that may cross these
  std::array<uint32_t, Hole::kMaxRing> leaving_;  // crossings out of the star
  std::vector<Part> parts_;
  std::vector<InnerEdge> inner_edges_;  // and room for more
  size_t inner_edge_count_ = 0;
  bool known_ = true;
  std::vector<uint32_t> changed_;  // a path
};

}  // namespace mtdb::internal
