// SPDX-License-Identifier: Apache-2.0
// The unit of the build: a tile's triangles, each with all that the tile may know of it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/texture.h"

namespace mtdb::internal {

// A triangle of a round's mesh. It carries everything that a later round needs, so that rounds can
// stream: no table of the whole mesh is consulted.
struct TileTriangle {
  std::array<uint32_t, 3> vertices;  // the input's numbering, or behind it: see fan()
  std::array<Vec3i, 3> positions;    // grid
  float error = 0;                   // work units: bound on its distance to the input surface
  // The node that removes it lies in this cluster, at this in-slot; kNone32: full resolution.
  uint32_t child = kNone32;
  uint32_t child_slot = 0;
  uint32_t height = 0;  // longest path of nodes from it to the drain
  // Packed: of edge i, (i, i+1), its order in bits 4i .. 4i+3; bits 12 .. 14: fixed corners; bit
  // 15: two-sided.
  uint16_t edges = 0;
  // Packed: of corner i, its fan in bits 4i .. 4i+3; bit 12: the child needs slot and rotation
  // named; bits 13 .. 15: of corner i, whether its vertex has fans behind this one.
  uint16_t fans = 0;

  // 0: the edge is no crease. Else how many triangles are at it: 1 on the surface's border. Those
  // that are two-sided count once.
  uint32_t order(uint32_t i) const { return edges >> 4 * i & 15u; }
  void set_order(uint32_t i, uint32_t order) {
    edges = static_cast<uint16_t>((edges & ~(15u << 4 * i)) | order << 4 * i);
  }
  // A vertex with m fans, 2 .. kMostOrder, has a number for each of them, m in a row: fan f of it,
  // 0 .. m - 1, has the f-th of them. Others have fan 0.
  uint32_t fan(uint32_t corner) const { return fans >> 4 * corner & 15u; }
  void set_fan(uint32_t corner, uint32_t fan) {
    fans = static_cast<uint16_t>((fans & ~(15u << 4 * corner)) | fan << 4 * corner);
  }
  bool more_fans(uint32_t corner) const { return (fans >> (13 + corner) & 1) != 0; }
  void set_more_fans(uint32_t corner, bool is) {
    fans = static_cast<uint16_t>((fans & ~(1u << (13 + corner))) | (is ? 1u : 0u) << (13 + corner));
  }
  // Of its vertex: the number of fan 0.
  uint32_t seat(uint32_t corner) const { return vertices[corner] - fan(corner); }
  // The corner's vertex stays, whatever the error: it is a node of the graph of creases.
  bool fixed(uint32_t corner) const { return (edges >> (12 + corner) & 1) != 0; }
  void set_fixed(uint32_t corner, bool is) {
    edges =
        static_cast<uint16_t>((edges & ~(1u << (12 + corner))) | (is ? 1u : 0u) << (12 + corner));
  }
  // It stands for its opposite, too: the triangle of the same corners that runs the other way.
  bool two_sided() const { return (edges & kTwoSided) != 0; }
  void set_two_sided(bool is) {
    edges = static_cast<uint16_t>((edges & ~kTwoSided) | (is ? kTwoSided : 0u));
  }
  // What TileTriangle::edges says of the triangle, whatever its corners are.
  static constexpr uint32_t kTwoSided = 1u << 15;
  // How many triangles it stands for.
  uint32_t sides() const { return two_sided() ? 2 : 1; }
  bool explicit_arc() const { return (fans >> 12 & 1) != 0; }
  void set_explicit_arc(bool is) {
    fans = static_cast<uint16_t>((fans & ~(1u << 12)) | (is ? 1u : 0u) << 12);
  }
};
static_assert(sizeof(TileTriangle) == 68 && offsetof(TileTriangle, fans) == 66);

// More triangles at a crease than this, and its ends stay; as many fans are told apart.
constexpr uint32_t kMostOrder = 15;

// Of a textured object, whose rows of corners end with a TextureCorner.
struct TileTexture {
  double step = 0;   // of u and v; 0: none
  double scale = 0;  // of a unit of u and v, in work units: what it counts when it is displaced
};

// Some triangles, with the attribute rows of their corners (three a triangle).
struct TriangleBlock {
  std::vector<TileTriangle> triangles;
  Bytes rows;

  // Of corner `corner` (3 * triangle + 0 .. 2), in rows of so many bytes that end with it.
  TextureCorner texture(uint64_t corner, size_t row_bytes) const {
    TextureCorner texture;
    std::memcpy(&texture, rows.data() + (corner + 1) * row_bytes - sizeof(texture),
                sizeof(texture));
    return texture;
  }
};

// A vertex removal, to be read backwards as a node. All fans of the vertex go at once; each leaves
// a hole of its own.
struct Removal {
  uint32_t vertex = 0;                      // local; of its first fan
  double error = 0;                         // work units; bound for all its holes
  uint32_t hole_begin = 0, hole_count = 0;  // ranges in TileResult::holes, hole by hole
  uint32_t star_begin = 0, star_count = 0;  // ranges in TileResult::stars, likewise
  // 0: inside of the surface. Else the order of the creases that the vertex was on, of which each
  // hole makes one edge: 1 on the surface's border. A hole has one triangle less than its fan then,
  // otherwise two.
  uint32_t fans = 0;
};

// A small part of the surface that vanished as a whole before anything else, to be read backwards
// as a node: it takes triangles near the crumb away, its triggers, and puts them back with it.
struct Crumb {
  double error = 0;                     // work units; no point of it is farther from the mesh left
  std::vector<uint32_t> triggers;       // triangles of the tile without crumbs
  std::vector<TileTriangle> triangles;  // that vanished; vertices not of triggers are its own
  Bytes rows;                           // of their corners, three a triangle
  uint32_t height = 0;                  // longest path of nodes from its node to the drain
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
  std::vector<uint32_t> vertices;                  // of local vertices: TileTriangle's numbering
  std::vector<uint8_t> fans;                       // likewise: which fan of its vertex it is
  std::vector<uint8_t> more_fans;                  // likewise: its vertex has fans behind it
  std::vector<uint32_t> first_twins;               // likewise: the fan that stands for the vertex
  std::vector<uint32_t> first_corner;              // likewise: 3 * input triangle + corner
  std::vector<Vec3i> positions;                    // of local vertices
  std::vector<std::array<uint32_t, 3>> triangles;  // all local triangles
  std::vector<float> errors;                       // of all local triangles
  // Likewise, as TileTriangle::edges has them: the edges' orders, and whether it is two-sided.
  std::vector<uint16_t> edge_orders;
  std::vector<uint8_t> alive;     // likewise
  std::vector<uint8_t> fixed;     // of local vertices: never removed anywhere
  std::vector<Removal> removals;  // in order of removal
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
