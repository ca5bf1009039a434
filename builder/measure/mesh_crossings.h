// SPDX-License-Identifier: Apache-2.0
// MeshCrossings: the edges of the tile's mesh, current and past, and which edges of the surface S
// cross them.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/holes/hole.h"
#include "builder/holes/tile_mesh.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// A crossing names an edge of the mesh and the triangle that is left through it: twice the edge's
// number, and 1 for one of its two. So each half-edge has a crossing, and its twin the one in the
// other direction. Work of one thread.
class MeshCrossings {
 public:
  struct MeshEdge {
    uint32_t head = kNone32;  // of a list: edges of S that cross it, or did
    uint32_t coded_in = 0;    // the last hole that has it ...
    uint8_t code = 0;         // ... and what it is there (SurfaceMap)
  };

  static constexpr uint32_t Twin(uint32_t crossing) { return crossing ^ 1; }
  void Build(const TileMesh& mesh);
  uint32_t half_edges() const { return static_cast<uint32_t>(of_.size()); }
  uint32_t Of(uint32_t half_edge) const { return of_[half_edge]; }
  // Of the mesh's edges; those from first_made() on were made in this tile.
  uint32_t edges() const { return static_cast<uint32_t>(edges_.size()); }
  uint32_t first_made() const { return first_made_; }
  MeshEdge& operator[](uint32_t edge) { return edges_[edge]; }
  const MeshEdge& operator[](uint32_t edge) const { return edges_[edge]; }
  // Numbers the edges of a filling, whose triangles are numbered from `first`; `leaving`: the
  // crossings out of the star, by ring edge. Gives the crossings of diagonals, by the triangle that
  // hangs on each, towards triangle 0.
  std::array<uint32_t, Hole::kMaxRing> NumberFilling(const Hole& hole,
                                                     const Hole::Triangles& triangles,
                                                     std::span<const uint32_t> leaving,
                                                     uint32_t first);

  void AddCrosser(uint32_t crossing, uint32_t edge_of_s);
  void FreeCrossers(uint32_t edge);
  // Calls f(edge of S) for all that cross the edge, or did.
  template <typename F>
  void ForEachCrosser(uint32_t edge, F&& f) const {
    for (uint32_t c = edges_[edge].head; c != kNone32; c = crossers_[c].next) f(crossers_[c].edge);
  }

 private:
  struct Crosser {  // in a list
    uint32_t edge = 0, next = kNone32;
  };
  uint32_t NewEdge() {
    edges_.push_back({});
    return edges() - 1;
  }

  std::vector<uint32_t> of_;  // half-edges
  std::vector<MeshEdge> edges_;
  std::vector<Crosser> crossers_;
  uint32_t free_crossers_ = kNone32;
  uint32_t first_made_ = 0;
};

}  // namespace mtdb::internal
