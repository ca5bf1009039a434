// SPDX-License-Identifier: Apache-2.0
// TileMesh: the triangles of a tile while vertices are removed from it.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/disk/tile.h"
#include "builder/holes/hole.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// Half-edges of a triangle, in its orientation.
constexpr uint32_t Next(uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
constexpr uint32_t Previous(uint32_t h) { return h % 3 == 0 ? h + 2 : h - 1; }

// Triangles and vertices have local numbers: the tile's triangles first, then those that fillings
// made; vertices in order of first use. Half-edge 3 * triangle + i leaves corner i for corner i
// + 1. Keeps topology and orientation: what it is asked to do is legal, see EdgesAreFree and
// ForbidEdges. A vertex on the tile's seam, or one that stays everywhere, is locked. One that may
// have triangles in other tiles is outside.
//
// The sheets that meet in a chain of creases are apart here: a vertex of the chain is as many
// vertices as it has fans, its twins, each on the border of its sheet. They have one place, and go
// together. An edge joins two vertices when it joins any twins of them.
class TileMesh {
 public:
  // `grid` gives the tile's positions in work units: grid steps, or model units when lossless. Of a
  // height field, edges are segments in the plane, so that no two of them have the same ends: all
  // that are asked for are free. `has_crumbs`: small parts may vanish from the surface, or have
  // (RemoveCrumbs). One that comes back may have an edge between two vertices that stay, so that
  // all of these are outside then.
  void Load(std::span<const TileTriangle> tile, const Grid& grid, bool is_height_field,
            bool has_crumbs = true);

  uint32_t vertices() const { return static_cast<uint32_t>(vertices_.size()); }
  uint32_t triangles() const { return static_cast<uint32_t>(triangles_.size()); }
  uint32_t live_triangles() const { return live_triangles_; }
  // All that ever were, with the opposites of those that are two-sided.
  uint32_t sides() const { return triangles() + two_sided_; }
  // The input's numbering.
  std::span<const uint32_t> vertex_numbers() const { return vertices_; }
  // Of a vertex: 3 * triangle + corner, of the tile as it was loaded.
  uint32_t first_corner(uint32_t v) const { return first_corner_[v]; }
  bool locked(uint32_t v) const { return places_[v].locked; }
  bool fixed(uint32_t v) const { return fixed_[v] != 0; }  // stays everywhere
  // The next fan of the vertex, after the last one the first; v when it is the only one.
  uint32_t twin(uint32_t v) const { return places_[v].twin; }
  // Fan 0 of the vertex.
  uint32_t first_twin(uint32_t v) const { return places_[v].first_twin; }
  bool removed(uint32_t v) const { return places_[v].removed; }
  Vec3d position(uint32_t v) const { return places_[v].position; }  // work units
  const std::array<uint32_t, 3>& corners(uint32_t t) const { return triangles_[t].corners; }
  // The tile as it was loaded: triangles, and twins of half-edges; kNone32 at the rim.
  std::span<const std::array<uint32_t, 3>> input_corners() const { return input_corners_; }
  std::span<const uint32_t> input_opposites() const { return input_opposites_; }

  // Fills in what a hole is, of a vertex that is there and not locked; of one of its fans. False
  // when it has more than `limit` neighbours (at most Hole::kMaxRing).
  bool OpenHole(uint32_t v, uint32_t limit, Hole& hole) const;
  // False when no filling of the hole is legal: the new border edge exists already, or the new
  // triangle has no vertex that is not outside, would close a tetrahedron, or have creases all
  // around.
  bool EdgesAreFree(const Hole& hole) const;
  // Sets hole.forbidden: edges between two vertices that are outside (a neighbouring tile may hold
  // or make the same edge) and, when `existing`, edges that are there.
  void ForbidEdges(Hole& hole, bool existing);
  // True when a diagonal of the filling is an edge of the mesh already.
  bool UsesExistingEdge(const Hole& hole, const Hole::Triangles& triangles) const;
  // Puts the filling in the place of the vertex and its star. Leaves the error of the removal open.
  Removal Fill(const Hole& hole, const Hole::Triangles& triangles);
  // Likewise of the next fan of the same vertex, whose first one was filled last.
  void Fill(const Hole& hole, const Hole::Triangles& triangles, Removal& removal);

  // All but removals, errors and counts.
  void CopyTo(TileResult& result) const;

 private:
  // Holes open anywhere in the tile: what is read of a triangle or a vertex lies together.
  struct alignas(32) Triangle {  // current or past
    std::array<uint32_t, 3> corners;
    std::array<uint32_t, 3> opposites{kNone32, kNone32, kNone32};
    uint16_t orders = 0;  // as TileResult::edge_orders
    bool alive = true;
    uint32_t order(uint32_t side) const { return orders >> 4 * side & 15u; }
  };
  struct alignas(32) Place {  // of a vertex
    Vec3d position;
    uint32_t half_edge = kNone32;  // outgoing; of a border vertex the one on the border
    uint32_t twin = 0, first_twin = 0;
    uint8_t order = 0;  // of the creases at it; 0: none
    bool locked = false, removed = false;
    bool outside = false;  // has triangles in other tiles, or may have
  };
  void FindTwins(std::span<const TileTriangle> tile);
  void NumberVertices(std::span<const TileTriangle> tile);
  void LinkFilling(const Hole& hole, const Hole::Triangles& triangles, uint32_t first);
  bool outside(uint32_t v) const { return places_[v].outside; }
  bool AreAdjacent(uint32_t whole, uint32_t other) const;
  // Calls f(w) for the neighbours of a vertex in its fan, which is here as a whole, until it
  // returns true; says whether it did.
  template <typename F>
  bool AnyNeighbour(uint32_t v, F&& f) const;

  uint32_t Origin(uint32_t h) const { return triangles_[h / 3].corners[h % 3]; }
  uint32_t order(uint32_t h) const { return triangles_[h / 3].order(h % 3); }
  uint32_t opposite(uint32_t h) const { return triangles_[h / 3].opposites[h % 3]; }
  uint32_t& opposite(uint32_t h) { return triangles_[h / 3].opposites[h % 3]; }

  std::vector<Triangle> triangles_;
  std::vector<std::array<uint32_t, 3>> input_corners_;
  std::vector<uint32_t> input_opposites_;
  // Vertices.
  std::vector<Place> places_;
  std::vector<uint32_t> vertices_;      // the input's numbering
  std::vector<uint32_t> first_corner_;  // 3 * input triangle + corner
  std::vector<Vec3i> grid_positions_;
  std::vector<uint8_t> fixed_, fans_, more_fans_;
  bool has_twins_ = false;
  std::vector<uint32_t> ring_mark_;
  // Of removals.
  std::vector<uint32_t> holes_, stars_;
  uint32_t live_triangles_ = 0;
  uint32_t two_sided_ = 0;
  bool is_height_field_ = false;
};

// Pairs half-edges with their twins; kNone32 where there is none or where an edge occurs more than
// once in one direction.
void PairHalfEdges(std::span<const std::array<uint32_t, 3>> triangles, uint32_t vertex_count,
                   std::vector<uint32_t>& opposite);

}  // namespace mtdb::internal
