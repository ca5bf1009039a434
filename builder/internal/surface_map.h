// SPDX-License-Identifier: Apache-2.0
// SurfaceMap: a map of the surface S that errors are measured against onto the tile's mesh, which
// follows the mesh as it changes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/internal/hole.h"
#include "builder/internal/tile.h"
#include "builder/internal/tile_mesh.h"
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
  // Where a part of a path that lies in the star begins or ends.
  struct End {
    enum Kind : uint32_t { kOutside, kSample, kRingEdge, kRingVertex };
    Kind kind : 2 = kOutside;
    uint32_t index : 30 = 0;  // of the sample, or ring position: of an edge, its first vertex
  };
  struct Part {
    uint32_t edge = 0;  // of S
    End from, to;
    uint32_t begin = 0, end = 0;  // its crossings, of the path's
  };
  struct InnerEdge {  // of S, with both ends in the star
    uint32_t edge = 0;
    End from, to;
  };
  // Which diagonals of a filling lie between an end and the filling's first triangle, a bit for the
  // triangle that hangs on each; and on which of them it lies itself.
  struct Behind {
    uint32_t behind = 0, on = 0;
  };
  // Of the parts of a path in a filling.
  class Masks {
   public:
    void Set(const Hole& hole, const Hole::Triangles& triangles);
    Behind Of(End end, std::span<const uint8_t> homes) const {
      if (end.kind == End::kSample) return {triangle_[homes[end.index]], 0};
      if (end.kind == End::kRingEdge) return {ring_edge_[end.index], 0};
      return ring_vertex_[end.index];
    }

    // The diagonals that lie between two ends.
    uint32_t Between(End a, End b, std::span<const uint8_t> homes) const {
      const Behind from = Of(a, homes);
      const Behind to = Of(b, homes);
      return (from.behind ^ to.behind) & ~(from.on | to.on);
    }

   private:
    std::array<uint32_t, Hole::kMaxRing> triangle_, ring_edge_;
    std::array<Behind, Hole::kMaxRing> ring_vertex_;
  };

  // `triangles` and `errors`: of S, whose vertices are the mesh's and others, with these `numbers`
  // in the input. Every edge follows itself.
  void Build(const TileMesh& mesh, std::span<const std::array<uint32_t, 3>> triangles,
             std::span<const float> errors, std::span<const uint32_t> numbers);
  // Of a surface that earlier rounds have moved on; once, after Build.
  void AddChords(std::vector<Chord> chords, const TileMesh& mesh,
                 std::span<const uint32_t> numbers);
  // What the next round needs, of the triangles that are there.
  void Hold(std::span<const uint8_t> alive, std::vector<Chord>& chords) const;

  struct Edge {                 // of S
    uint32_t from = 0, to = 0;  // from the end with the smaller number in the input to the other
    uint32_t path_at = 0;       // of its path: in pool_, a length and the crossings; 0: none
    float error = 0;            // the largest that its triangles have accumulated
  };
  const Edge& edge(uint32_t e) const { return edges_[e]; }
  // Whether the edge crosses something.
  bool HasPath(uint32_t e) const { return edges_[e].path_at != 0; }

  // Of a hole: Open, then MarkSample and MarkChain for the vertices of S whose places will change,
  // or which lie on the border edges of the ring; then FindParts. False when a path is not known
  // well enough: the hole must stay.
  void Open(const Hole& hole);
  void MarkSample(uint32_t vertex, uint32_t sample) { Mark(vertex, {End::kSample, sample}); }
  void MarkChain(uint32_t vertex, uint32_t ring_edge) { Mark(vertex, {End::kRingEdge, ring_edge}); }
  bool FindParts();
  std::span<const Part> parts() const { return parts_; }
  // Those whose paths cross something are among the parts, and mean nothing here.
  std::span<const InnerEdge> inner_edges() const { return inner_edges_; }
  // The filling has been put in the mesh, its triangles numbered from `first`.
  void HandOn(const Hole& hole, const Hole::Triangles& triangles, const Masks& masks,
              std::span<const uint8_t> homes, uint32_t first);

 private:
  static constexpr uint32_t kGap = kNone32;  // in a path: a part of it that is outside the tile
  struct Crosser {                           // of an edge of the mesh, with others in a list
    uint32_t edge = 0, next = kNone32;
  };

  void AddEdges(std::span<const std::array<uint32_t, 3>> triangles, std::span<const float> errors,
                std::span<const uint32_t> numbers, uint32_t vertices);
  void NumberMeshEdges(const TileMesh& mesh);
  uint32_t FindEdge(uint32_t from, uint32_t to) const;
  void JoinChords(uint32_t edge, std::span<const Chord> chords, const TileMesh& mesh);
  uint32_t NewMeshEdge() {
    heads_.push_back(kNone32);
    return static_cast<uint32_t>(heads_.size() - 1);
  }
  void Mark(uint32_t vertex, End end) {
    places_[vertex] = {opened_, end};
    marked_.push_back(vertex);
  }
  End EndOf(uint32_t v) const { return places_[v].opened == opened_ ? places_[v].end : End{}; }
  void MarkMeshEdge(uint32_t half_edge, uint8_t code);
  bool FindParts(uint32_t edge);
  std::span<const uint32_t> path(uint32_t edge) const {
    const uint32_t at = edges_[edge].path_at;
    return at == 0 ? std::span<const uint32_t>{} : std::span(pool_).subspan(at + 1, pool_[at]);
  }
  std::array<uint32_t, Hole::kMaxRing> NumberFilling(const Hole& hole,
                                                     const Hole::Triangles& triangles,
                                                     uint32_t first);
  void Change(uint32_t edge, uint32_t made);
  void SetPath(uint32_t edge, std::span<const uint32_t> path);
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
  std::vector<uint32_t> pool_;
  size_t pool_unused_ = 0;
  // Of the mesh: twice the edge's number, and 1 for one of its two half-edges.
  std::vector<uint32_t> crossing_of_;
  std::vector<uint32_t> heads_;  // of the edges: lists of those of S that cross them, or did
  std::vector<Crosser> crossers_;
  uint32_t free_crossers_ = kNone32;
  uint32_t first_made_ = 0;  // edges of the mesh from here on were made in this tile

  // Of the open hole.
  uint32_t opened_ = 0;
  struct Place {  // of a vertex of S, when it was marked in the hole that is open
    uint32_t opened = 0;
    End end;
  };
  std::vector<Place> places_;
  std::vector<uint32_t> looked_at_in_, coded_in_;
  std::vector<uint8_t> codes_;  // of edges of the mesh: a ring position, or kSpoke
  std::vector<uint32_t> marked_;
  std::vector<uint32_t> star_edges_;
  std::array<uint32_t, Hole::kMaxRing> leaving_;  // crossings out of the star
  std::vector<Part> parts_;
  std::vector<InnerEdge> inner_edges_;
  bool known_ = true;
  std::vector<uint32_t> changed_;  // a path
};

}  // namespace mtdb::internal
