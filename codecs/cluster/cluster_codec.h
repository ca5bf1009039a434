// SPDX-License-Identifier: Apache-2.0
// The compressed form of a cluster. It is implicit: the decoder replays the updates. Specified in
// codecs/FORMAT.md. After the implicit coding of De Floriani, Magillo and Puppo, "Compressing
// triangulated irregular networks" and "VARIANT"; the order of nodes and the sorted arcs are ours.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "codecs/cluster/cluster.h"
#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/grid.h"
#include "store/base/status.h"

namespace mtdb {

// The updates of a tile, as the builder made them (removals, read backwards).
struct ClusterUpdates {
  // Where an out-triangle goes; none: full resolution.
  struct Consumer {
    UnitId child{kNone32};
    uint32_t child_slot = 0;
    bool explicit_arc = false;
  };
  // Inserts one vertex, in one hole, or in several that share an edge.
  struct Node {
    uint32_t vertex = 0;  // local
    uint8_t error_code = 0;
    uint32_t hole_begin = 0, hole_count = 0;  // ranges in `holes`
    uint32_t star_begin = 0, star_count = 0;  // ranges in `stars`
    // How many triangles are at the edge that the vertex splits, one in each hole, when they are
    // more than one.
    uint32_t fans = 0;
    // True when the vertex splits an edge of its holes: one triangle more in each instead of two.
    bool boundary() const { return fans > 1 || star_count == hole_count + 1; }
  };
  // A small part of the surface that comes as a whole: a node that takes triangles away, its
  // triggers, and puts them back with the part.
  struct Crumb {
    uint8_t error_code = 0;
    std::vector<uint32_t> triggers;   // 1 .. kMostCrumbTriggers
    std::vector<uint32_t> triangles;  // 1 .. kMostCrumbTriangles; among its vertices and theirs
    std::vector<uint32_t> vertices;   // local: its own
  };
  // Of a terrain: shapes are seen along z, and errors are heights.
  bool is_height_field = false;
  std::vector<Vec3i> positions;  // of local vertices
  Bytes rows;                    // attributes of local vertices
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<Consumer> consumers;  // per triangle; read for out-triangles only
  std::vector<uint8_t> two_sided;   // per triangle; empty: none is
  // Of textured objects, per triangle: its corners, and a bit for each edge, (i, i + 1), that is a
  // crease where two triangles run in opposite directions.
  std::vector<std::array<TextureCorner, 3>> corners;
  std::vector<uint8_t> seams;
  double corner_step = 0;   // of u and v; 0: none
  std::vector<Node> nodes;  // in any order
  // Each behind those that have one of its triggers, too: what a consumer says of that is of the
  // triangle that the last one puts back.
  std::vector<Crumb> crumbs;
  std::vector<uint32_t> holes;  // triangles
  std::vector<uint32_t> stars;  // triangles

  // Of nodes[i]: the triangles that it removes and those that it creates.
  std::span<const uint32_t> hole(size_t i) const {
    return std::span(holes).subspan(nodes[i].hole_begin, nodes[i].hole_count);
  }
  std::span<const uint32_t> star(size_t i) const {
    return std::span(stars).subspan(nodes[i].star_begin, nodes[i].star_count);
  }
};

struct EncodedCluster {
  Bytes payload;
  std::vector<UnitId> children;      // ascending
  std::vector<uint32_t> node_order;  // stored node -> ClusterUpdates::nodes; crumbs follow
  uint32_t nodes = 0;                // as the index counts them: crumbs by their vertices
  // Stored in-triangle -> ClusterUpdates::triangles, and which of its corners comes first.
  std::vector<uint32_t> in_triangles;
  std::vector<uint8_t> in_rotations;
  uint32_t out_triangles = 0;
  uint32_t external_vertices = 0;
  bool explicit_arcs = false;  // parents must name slots
};

// Deterministic. Updates that contradict each other are a caller's bug (MTDB_CHECK).
EncodedCluster EncodeCluster(const ClusterUpdates& updates, const AttributeLayout& attributes);

// The updates that the cluster was encoded from, in the order of the cluster. `is_height_field`: of
// a terrain, as the object's record says.
ClusterUpdates UpdatesOf(const Cluster& cluster, bool is_height_field);

// Replays `payload` on `in`, whose rows must be filled, two_sided where the parents have such, and
// corners with their step when the object is textured.
// Memory and time are bounded by the payload's length and `node_limit` (from the index). `where`
// names the cluster in messages. Errors: kCorrupt.
Result<Cluster> DecodeCluster(ByteSpan payload, InPatch in, const AttributeLayout& attributes,
                              uint32_t node_limit, const std::string& where);

// The size of each stream of a payload, for `info` and the benchmarks.
struct StreamSize {
  const char* name;
  uint32_t raw_bytes;
  uint32_t coded_bytes;
};
std::vector<StreamSize> ClusterStreamSizes(ByteSpan payload);

}  // namespace mtdb
