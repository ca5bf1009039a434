// SPDX-License-Identifier: Apache-2.0
// The unit of the build: a tile's triangles, each with all that the tile may know of it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// A triangle of a round's mesh. It carries everything that a later round needs, so that rounds can
// stream: no table of the whole mesh is consulted.
struct TileTriangle {
  std::array<uint32_t, 3> vertices;  // the input's numbering
  std::array<Vec3i, 3> positions;    // grid
  float error = 0;                   // work units: bound on its distance to the input surface
  // The node that removes it lies in this cluster, at this in-slot; kNone32: full resolution.
  uint32_t child = kNone32;
  uint32_t child_slot = 0;
  uint32_t height = 0;        // longest path of nodes from it to the drain
  uint8_t border_edges = 0;   // bit i: edge (i, i+1) lies on the surface's border
  uint8_t fixed_corners = 0;  // bit i: corner i is at a non-manifold vertex or edge
  bool explicit_arc = false;  // the child needs slot and rotation named
  uint8_t unused = 0;         // instead of padding: a triangle's bytes are hashed and noted down
};
static_assert(sizeof(TileTriangle) == 68 && offsetof(TileTriangle, unused) == 67);

// Some triangles, with the attribute rows of their corners (three a triangle).
struct TriangleBlock {
  std::vector<TileTriangle> triangles;
  Bytes rows;
};

// A vertex removal, to be read backwards as a node.
struct Removal {
  uint32_t vertex = 0;                      // local
  double error = 0;                         // work units; bound for its whole hole
  uint32_t hole_begin = 0, hole_count = 0;  // ranges in TileResult::holes
  uint32_t star_begin = 0, star_count = 0;  // ranges in TileResult::stars
  // True when the vertex was on the surface's border: one triangle less instead of two.
  bool boundary() const { return star_count == hole_count + 1; }
};

// Where an edge of the surface that errors are measured against runs over a triangle of the mesh,
// on the way of its path from one end to the other (SurfaceMap).
struct Chord {
  uint32_t from = 0, to = 0;  // the edge's ends, the one with the smaller number in the input first
  float error = 0;            // work units; accumulated in the triangles of that edge
  uint32_t triangle = 0;
  uint8_t enters = 3,
          leaves = 3;  // through these edges of the triangle; 3: the path begins or ends
  std::array<uint8_t, 2> unused{};  // instead of padding
};
static_assert(sizeof(Chord) == 20);

// What decimating a tile leaves. Local triangles: the input's, then the created ones.
struct TileResult {
  std::vector<uint32_t> vertices;                  // of local vertices: the input's numbering
  std::vector<uint32_t> first_corner;              // likewise: 3 * input triangle + corner
  std::vector<Vec3i> positions;                    // of local vertices
  std::vector<std::array<uint32_t, 3>> triangles;  // all local triangles
  std::vector<float> errors;                       // of all local triangles
  std::vector<uint8_t> border_edges;               // likewise
  std::vector<uint8_t> alive;                      // likewise
  std::vector<uint8_t> fixed;                      // of local vertices: never removed anywhere
  std::vector<Removal> removals;                   // in order of removal
  std::vector<uint32_t> holes, stars;
  // Of measures that go on from round to round (TileSurface); else empty. Of half-edges, of all
  // local triangles; of the removed vertices that triangles stand for: local vertex (those of the
  // surface beneath follow, see NumberVertices), local triangle, and the border edge on whose curve
  // it lies, or 3; and paths on triangles that are there.
  std::vector<float> edge_errors;
  std::vector<std::array<uint32_t, 3>> held;
  std::vector<Chord> chords;
  uint64_t locked_vertices = 0;
  uint64_t seam_vertices = 0;  // of these, those that only the tile's seam locks
  uint64_t stuck_topology = 0;
  uint64_t stuck_degree = 0;
};

}  // namespace mtdb::internal
