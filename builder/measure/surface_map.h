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
#include "store/base/ids.h"

namespace mtdb::internal {

// A vertex of S lies at a vertex of the mesh or, when it is removed, in a triangle of the mesh that
// is named its home, or on an edge of the border. An edge of S then follows a path from the place
// of one end to that of the other, from triangle to triangle; the map keeps which edges of the mesh
// it crosses, one after the other. Where exactly homes and crossings lie is nobody's business:
// docs/design.md, section 3, says what follows for the distance.
//
// A crossing names an edge of the mesh and the triangle that is left through it; so each half-edge
// has a crossing, and its twin the one in the other direction. Work of one thread.
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

  // Of S; what is read of one lies in half a cache line.
  struct alignas(32) Edge {
    static constexpr uint32_t kShort = 3;
    uint32_t from = 0, to = 0;  // from the end with the smaller number in the input to the other
    float error = 0;            // the largest that its triangles have accumulated
    uint32_t length = 0;        // of its path
    // The path; of a longer one, where it is in pool_, and for how many there is room.
    std::array<uint32_t, kShort> crossings{};
    uint32_t looked_at_in = 0;  // the last hole
  };
  const Edge& edge(uint32_t e) const { return edges_[e]; }
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
  struct Crosser {                           // of an edge of the mesh, with others in a list
    uint32_t edge = 0, next = kNone32;
  };

  void AddEdges(std::span<const std::array<uint32_t, 3>> triangles,
                std::span<const uint32_t> opposites, std::span<const float> errors,
                std::span<const uint32_t> numbers);
  void NumberMeshEdges(const TileMesh& mesh);
  uint32_t FindEdge(uint32_t from, uint32_t to) const;
  void JoinChords(uint32_t edge, std::span<const Chord> chords, const TileMesh& mesh);
  uint32_t NewMeshEdge() {
    mesh_edges_.push_back({});
    return static_cast<uint32_t>(mesh_edges_.size() - 1);
  }
  void Mark(uint32_t vertex, End end) {
    places_[vertex] = {opened_, end};
    marked_.push_back(vertex);
    __builtin_prefetch(&edges_begin_[vertex]);
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
  std::span<const uint32_t> path(const Edge& edge) const {
    if (edge.length <= Edge::kShort) return std::span(edge.crossings).first(edge.length);
    return std::span(pool_).subspan(edge.crossings[0], edge.length);
  }
  std::array<uint32_t, Hole::kMaxRing> NumberFilling(const Hole& hole,
                                                     const Hole::Triangles& triangles,
                                                     uint32_t first);
  void Change(uint32_t edge, uint32_t made);
  void SetPath(Edge& edge, std::span<const uint32_t> path);
  void DropUnused();
  void AddCrosser(uint32_t crossing, uint32_t edge);
  void FreeCrossers(uint32_t mesh_edge);
  void Reduce(std::vector<uint32_t>& path) const;

  // Of S.
  struct EdgeAt {  // a vertex
    uint32_t begins_here : 1 = 0;
    uint32_t edge : 31 = 0;
    uint32_t other_end = 0;
  };
  std::vector<Edge> edges_;
  std::vector<uint32_t> edges_begin_;  // of the vertices
  std::vector<EdgeAt> edges_at_;
  std::vector<uint32_t> pool_;  // paths that are not short
  size_t pool_unused_ = 0;
  // Of the mesh's half-edges: twice the edge's number, and 1 for one of its two.
  std::vector<uint32_t> crossing_of_;
  struct MeshEdge {
    uint32_t head = kNone32;  // of a list: edges of S that cross it, or did
    uint32_t coded_in = 0;    // the last hole that has it
    uint8_t code = 0;         // there: a ring position, or kSpoke
  };
  std::vector<MeshEdge> mesh_edges_;
  std::vector<Crosser> crossers_;
  uint32_t free_crossers_ = kNone32;
  uint32_t first_made_ = 0;  // edges of the mesh from here on were made in this tile

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
