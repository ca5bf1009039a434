// SPDX-License-Identifier: Apache-2.0
// Cluster: a decoded cluster in explicit form, and the patch of triangles that it grows from.
//
// A cluster is a set of nodes of the Multi-Triangulation that one tile of one round produced. Its
// nodes remove in-triangles, which its parents (coarser clusters, or pieces of the root) create.
// They leave out-triangles, which its children remove or which belong to the full-resolution mesh.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/base/texture.h"

namespace mtdb {

// Who removes the triangle in a slot, as Cluster::removers has it: a node of the cluster (its
// number), a child, or nobody.
inline constexpr uint32_t kDrain = kNone32;          // nobody removes it: full resolution
inline constexpr uint32_t kChildFlag = 0x80000000u;  // | ordinal in `children`: a child removes it
constexpr bool RemovedByNode(uint32_t remover) { return (remover & kChildFlag) == 0; }
constexpr bool RemovedByChild(uint32_t remover) {
  return (remover & kChildFlag) != 0 && remover != kDrain;
}
constexpr uint32_t ChildOrdinal(uint32_t remover) { return remover & ~kChildFlag; }

// An arc to a child some of whose in-triangles have equal positions on the grid, so that sorting
// does not tell their slots.
struct ExplicitArc {
  uint32_t slot = 0;        // of the parent
  uint32_t child_slot = 0;  // of the child
  uint8_t rotation = 0;     // the child's first corner is the parent's corner `rotation`
  friend bool operator==(const ExplicitArc&, const ExplicitArc&) = default;
};

// Which triangle is in an in-slot, and which of its corners comes first there.
struct InSlot {
  uint32_t triangle = 0;
  uint32_t first_corner = 0;
};

// Rotates each triangle so that the sequence of its corners' positions is the smallest, and sorts
// the triangles by these sequences. In this order a child numbers its in-triangles, so that no
// numbers need to be stored. The corners are indices of `positions`. Where two triangles, or two
// rotations of one, have the same sequence, the order is not `unique` (see ExplicitArc).
struct CanonicalOrder {
  std::vector<InSlot> slots;
  bool unique = true;
};
CanonicalOrder SortCanonically(std::span<const std::array<uint32_t, 3>> triangles,
                               std::span<const Vec3i> positions);

// The listed triangles of a unit in the order of their slots: the in-triangles of a cluster, or the
// triangles of a root piece. Their corners are numbered by first occurrence: local vertices.
struct InPatch {
  std::vector<std::array<uint32_t, 3>> triangles;  // local vertices
  std::vector<Vec3i> positions;                    // of local vertices
  std::vector<VertexIndex> vertices;               // of local vertices
  Bytes rows;                                      // attributes of local vertices
  // Per slot: the triangle is two-sided, and stands for its opposite as well. Empty: none is.
  std::vector<uint8_t> two_sided;
  // Of textured objects: three per slot, and the step of u and v. Else empty.
  std::vector<TextureCorner> corners;
  double corner_step = 0;
  // Of a decoded cluster: per slot, those that its nodes create among them, the places of its
  // corners in `corners`; and per listed one bits of edges that are seams although their corners do
  // not tell.
  std::vector<std::array<uint32_t, 3>> corner_places;
  std::vector<uint8_t> seams;
};

// Puts triangles into their slots and numbers their corners by first occurrence. The members of
// `vertices` are what the triangles' corners are: indices of `positions`. Leaves rows empty, and
// what is two-sided.
InPatch MakeInPatch(std::span<const std::array<uint32_t, 3>> triangles,
                    std::span<const Vec3i> positions, std::span<const InSlot> slots);

// The indices first .. last - 1.
struct IndexRange {
  struct Iterator {
    uint32_t index;
    uint32_t operator*() const { return index; }
    Iterator& operator++() {
      ++index;
      return *this;
    }
    friend bool operator==(Iterator, Iterator) = default;
  };
  uint32_t first = 0, last = 0;

  Iterator begin() const { return {first}; }
  Iterator end() const { return {last}; }
  uint32_t front() const { return first; }
  uint32_t size() const { return last - first; }
};

// Of nodes that bring a crumb (codecs/FORMAT.md), in Cluster::fans. Such a node has a number for
// each vertex of the crumb, one behind the other; the first one has all triangles, the others none.
// One without vertices has a number, too, whose vertex is a copy of another one and in no triangle.
inline constexpr uint8_t kCrumb = 255;
inline constexpr uint8_t kCrumbWithoutVertex = 254;

// What a node does to the mesh: it removes some triangles and creates others with the same border,
// among the vertices around and new ones. Nearly all nodes that the codec writes insert one vertex
// with a star of triangles around it; who asks for the shape need not know that.
struct NodeShape {
  std::span<const uint32_t> removed;  // slots
  IndexRange created;                 // slots
  IndexRange vertices;                // local: those that the node creates
};

// The explicit form. Local vertices: 0 .. external_vertices()-1 are the corners of listed
// triangles, then come those that node 0 creates, node 1, ... Slots: the listed triangles, then
// those that node 0 creates, node 1, ... A node's ring is the vertices around its hole,
// counter-clockwise. A star's triangle j is (the node's vertex, ring[j], ring[j+1]); the ring of an
// interior node is cyclic, that of a boundary node is open (one star triangle less). A node of
// several fans has as many holes, which share the edge that its vertex splits: a hole is open like
// that of a boundary node, and its ring is the vertices around all holes, each once. Nodes are in
// an order that every parent precedes its children.
//
// Parents create the slots below first_own_slot, the cluster itself the others. A piece of the root
// mesh is a cluster without nodes: it lists triangles and consumes none.
struct Cluster {
  // Positions and rows are extended by the nodes' own, and what is two-sided by their triangles:
  // these are what those of the hole are, fan by fan. Corners are extended by one for each fan of a
  // node, and by three for each triangle of one that brings a crumb.
  InPatch in;
  uint32_t first_own_slot = 0;          // parents create those below: all that are listed, or none
  std::vector<uint8_t> error_codes;     // per node
  std::vector<uint32_t> ring_begin;     // nodes + 1
  std::vector<uint32_t> ring_vertices;  // local
  std::vector<uint32_t> star_begin;     // nodes + 1; slots that a node creates
  std::vector<uint32_t> hole_begin;     // nodes + 1
  std::vector<uint32_t> hole_slots;     // slots that a node removes
  std::vector<uint32_t> removers;       // per slot: node, kChildFlag | ordinal, or kDrain
  std::vector<UnitId> children;         // ascending
  std::vector<ExplicitArc> explicit_arcs;  // ascending by slot
  // Empty when each node inserts one vertex.
  std::vector<uint32_t> vertex_begin;  // nodes + 1; local vertices
  // Of slots listed() + 0, 1, ...; empty when each node's star is one around its ring.
  std::vector<std::array<uint32_t, 3>> created_corners;
  // Per node: how many open fans its star is; 0 for a closed one; kCrumb, kCrumbWithoutVertex.
  // Empty when none has several, or brings a crumb.
  std::vector<uint8_t> fans;
  std::vector<uint32_t> later_fans;  // the slots at which second and later fans begin, ascending

  uint32_t nodes() const { return static_cast<uint32_t>(error_codes.size()); }
  uint32_t in_triangles() const { return first_own_slot; }
  uint32_t listed() const { return static_cast<uint32_t>(in.triangles.size()); }
  uint32_t external_vertices() const { return static_cast<uint32_t>(in.vertices.size()); }
  uint32_t slots() const { return static_cast<uint32_t>(removers.size()); }
  NodeShape shape(NodeIndex i) const {
    return {hole(i), {star_begin[i], star_begin[i + 1]}, {first_vertex(i), first_vertex(i + 1)}};
  }
  // That node i creates; of nodes(): one beyond the last.
  uint32_t first_vertex(NodeIndex i) const {
    return vertex_begin.empty() ? external_vertices() + i : vertex_begin[i];
  }
  // True when the node's vertex splits an edge of the surface's border, or another crease.
  bool boundary(NodeIndex i) const {
    if (!fans.empty()) return fans[i] != 0;
    return star_begin[i + 1] - star_begin[i] + 1 == ring_begin[i + 1] - ring_begin[i];
  }
  // True when it brings a crumb, or is a further number of such a node.
  bool crumb(NodeIndex i) const { return !fans.empty() && fans[i] >= kCrumbWithoutVertex; }
  std::span<const uint32_t> ring(NodeIndex i) const {
    return std::span(ring_vertices).subspan(ring_begin[i], ring_begin[i + 1] - ring_begin[i]);
  }
  std::span<const uint32_t> hole(NodeIndex i) const {
    return std::span(hole_slots).subspan(hole_begin[i], hole_begin[i + 1] - hole_begin[i]);
  }
  Vec3i position(uint32_t local_vertex) const { return in.positions[local_vertex]; }
  // Corners of the triangle in `slot`, which node `i` created.
  std::array<uint32_t, 3> created_triangle(NodeIndex i, uint32_t slot) const {
    if (!created_corners.empty()) return created_corners[slot - listed()];
    const std::span<const uint32_t> r = ring(i);
    const uint32_t j = slot - star_begin[i];
    return {external_vertices() + i, r[j], r[j + 1 == r.size() ? 0 : j + 1]};
  }
  // Of textured objects: the corners of the triangle in `slot`.
  std::array<TextureCorner, 3> texture(uint32_t slot) const {
    const std::array<uint32_t, 3>& places = in.corner_places[slot];
    return {in.corners[places[0]], in.corners[places[1]], in.corners[places[2]]};
  }
  size_t memory_bytes() const;
};

}  // namespace mtdb
