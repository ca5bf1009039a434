// SPDX-License-Identifier: Apache-2.0
// What the update stream is encoded from: a base mesh, and batches of vertex insertions and
// removals in explicit form. The sender numbers vertices and triangles as it likes; these numbers
// do not travel.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb {

// Any number that tells a triangle from all others that a sender will ever name.
using TriangleKey = uint64_t;

// Says whether a triangle, in model units, meets the region that a client is clipped to. A null
// function stands for all of space.
using MeetsRegion = std::function<bool(const Triangle3d&)>;

// The mesh that a client starts from.
struct BaseMesh {
  std::vector<VertexIndex> vertices;
  std::vector<Vec3i> positions;
  Bytes rows;                                      // attributes of `vertices`
  std::vector<std::array<uint32_t, 3>> triangles;  // places in `vertices`
  std::vector<TriangleKey> triangle_keys;
};

// Updates that do not depend on each other: all insertions, or all removals. A node's insertion
// replaces its hole by its star; its removal does the reverse. Star triangle j of a node is
// (vertex, ring[j], ring[j+1]); the ring of a boundary node is open, its star has one triangle
// less, and its hole the edge from the last ring vertex to the first. A vertex with several holes
// has a node for each of them, one after the other: these are one update. They are the sheets that
// meet in an edge which the vertex splits, or the two sides of a sheet.
struct UpdateBatch {
  struct Node {
    VertexIndex vertex = 0;
    Vec3i position;
    bool boundary = false;
    TriangleKey first_star = 0;               // star triangle j has the key first_star + j
    uint32_t ring_begin = 0, ring_count = 0;  // in `ring`
    uint32_t hole_begin = 0;                  // in `holes`; ring_count - 2 of them
    bool twin = false;                        // another hole of the vertex before it
  };
  struct HoleTriangle {
    TriangleKey key = 0;
    std::array<uint8_t, 3> corners{};  // places in the node's ring
  };
  // A small part of the surface that comes (goes) as a whole. Some triangles beside it stay what
  // they are, but under other keys.
  struct Crumb {
    struct Renamed {
      TriangleKey without = 0, with = 0;  // the crumb
    };
    std::vector<VertexIndex> vertices;  // its own: no other triangle has one
    std::vector<Vec3i> positions;       // of `vertices`
    Bytes rows;                         // likewise
    std::vector<std::array<VertexIndex, 3>> triangles;
    std::vector<TriangleKey> keys;  // of `triangles`
    std::vector<Renamed> renamed;
  };
  bool insert = true;
  std::vector<Node> nodes;
  std::vector<VertexIndex> ring;
  std::vector<HoleTriangle> holes;
  Bytes rows;  // attributes of the nodes' vertices
  std::vector<Crumb> crumbs;

  // The nodes that are one update with node i, the first of them: i .. EndOfUpdate(i) - 1.
  size_t EndOfUpdate(size_t i) const {
    for (++i; i < nodes.size() && nodes[i].twin;) ++i;
    return i;
  }
  uint64_t updates() const {
    return crumbs.size() + static_cast<uint64_t>(std::ranges::count(nodes, false, &Node::twin));
  }
  std::span<const VertexIndex> ring_of(const Node& node) const {
    return std::span(ring).subspan(node.ring_begin, node.ring_count);
  }
  std::span<const HoleTriangle> hole_of(const Node& node) const {
    return std::span(holes).subspan(node.hole_begin, node.ring_count - 2);
  }
  static uint32_t StarCount(const Node& node) { return node.ring_count - (node.boundary ? 1 : 0); }
};

}  // namespace mtdb
