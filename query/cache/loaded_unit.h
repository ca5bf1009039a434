// SPDX-License-Identifier: Apache-2.0
// LoadedUnit: a decoded unit, and where its in-triangles come from.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "codecs/cluster/cluster.h"
#include "query/cache/compact_cluster.h"
#include "query/runtime_form.h"
#include "store/base/attributes.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/object_record.h"

namespace mtdb::internal {

// What an in-triangle of a cluster is to the unit that creates it.
struct SlotOrigin {
  LocalNumber parent = 0;  // ordinal in LoadedUnit::parents
  LocalNumber slot = 0;    // of the parent
  LocalNumber made_by = kNobody;

  // As LoadedUnit::creator() says of the parent.
  NodeIndex creator() const { return made_by == kNobody ? kNone32 : made_by; }
  static constexpr LocalNumber kNobody = 0xffff;
};

// A triangle that one unit creates and a child of it removes.
struct Arc {
  UnitId parent;
  uint32_t slot;  // of the parent
  friend auto operator<=>(const Arc&, const Arc&) = default;
};

constexpr uint32_t kLongStar = 16;  // triangles; nearly all stars have less

// Immutable once loaded; safe for many threads.
struct LoadedUnit {
  UnitId id = 0;
  CompactCluster cluster;
  std::vector<UnitId> parents;         // ascending
  std::vector<SlotOrigin> origins;     // per in-triangle
  std::vector<LocalNumber> by_origin;  // in-slots, ascending by their origin's parent and slot
  std::vector<UnitId> owners;   // per external vertex: the cluster that inserts it; kNone32: root
  std::vector<uint64_t> drain;  // a bit per own slot: part of the full-resolution mesh
  std::vector<LocalNumber> creators;   // of every kCreatorStep-th star slot, for creator()
  std::vector<LocalNumber> out_begin;  // children + 1
  std::vector<LocalNumber> out_slots;  // that children remove, child by child, ascending

  const LocalRemovers& removers() const { return cluster.removers; }
  const std::vector<UnitId>& children() const { return cluster.children; }
  const std::vector<ExplicitArc>& explicit_arcs() const { return cluster.explicit_arcs; }
  const LocalPositions& positions() const { return cluster.positions; }
  const Bytes& rows() const { return cluster.rows; }
  // Of an external vertex: its number in the object, and the cluster that inserts it, or kNone32.
  VertexIndex vertex(uint32_t local) const { return cluster.vertices[local]; }
  UnitId owner(uint32_t local) const { return owners[local]; }
  uint32_t nodes() const { return cluster.nodes(); }
  // Slots below this one are in-triangles; the unit creates the others.
  uint32_t first_own_slot() const { return cluster.first_own_slot; }
  uint32_t own_slots() const { return cluster.slots() - first_own_slot(); }
  // The node that creates a slot; kNone32 for a listed one.
  NodeIndex creator(uint32_t slot) const {
    const uint32_t listed = cluster.listed();
    if (slot < listed) return kNone32;
    NodeIndex node = creators[(slot - listed) / kCreatorStep];
    while (cluster.star_begin[node + 1] <= slot) ++node;
    return node;
  }
  // The slots that a child removes, ascending.
  std::span<const LocalNumber> slots_of_child(uint32_t ordinal) const {
    return {out_slots.data() + out_begin[ordinal], out_slots.data() + out_begin[ordinal + 1]};
  }
  // Begin to fetch what creator() and corners() will read.
  void PrefetchCreator(uint32_t slot) const {
    if (slot < cluster.listed()) return;
    const NodeIndex node = creators[(slot - cluster.listed()) / kCreatorStep];
    __builtin_prefetch(&cluster.star_begin[node + 1]);
    __builtin_prefetch(&cluster.ring_begin[node]);
  }
  void PrefetchCorners(uint32_t slot, NodeIndex creator_node) const {
    if (slot < cluster.listed()) {
      __builtin_prefetch(&cluster.triangles[slot]);
    } else {
      const uint32_t j = slot - cluster.star_begin[creator_node];
      __builtin_prefetch(cluster.ring_vertices.data() + cluster.ring_begin[creator_node] + j);
    }
  }
  // The local vertices of a slot, which `creator_node` creates.
  std::array<uint32_t, 3> corners(uint32_t slot, NodeIndex creator_node) const {
    if (slot < cluster.listed()) return cluster.listed_triangle(slot);
    return cluster.created_triangle(creator_node, slot);
  }
  // The bounds of what a node removes, and of that and what it creates.
  Box3i hole_bounds(NodeIndex node) const {
    Box3i bounds;
    for (const uint32_t local : cluster.ring(node)) bounds.Add(cluster.position(local));
    return bounds;
  }
  Box3i star_bounds(NodeIndex node) const {
    Box3i bounds = hole_bounds(node);
    for (const uint32_t local : cluster.created_vertices(node)) bounds.Add(cluster.position(local));
    return bounds;
  }
  // The in-slot that an arc arrives at, or kNone32.
  uint32_t FindInSlot(const Arc& arc) const;
  // Likewise of up to kArcsAtOnce: the searches wait for the memory together.
  static constexpr size_t kArcsAtOnce = 8;
  void FindInSlots(std::span<const Arc> arcs, uint32_t* slots) const;
  size_t memory_bytes() const;

  static constexpr uint32_t kCreatorStep = 16;
};

using LoadedUnitPtr = std::shared_ptr<const LoadedUnit>;

// "scan: cluster 12" or "scan: root piece 0", for messages.
std::string UnitName(const ObjectRecord& record, UnitId unit);

// Decodes a unit from its payload and its decoded parents (as the index lists them). Every
// disagreement of payload, parents and index is kCorrupt.
Result<LoadedUnitPtr> LoadUnit(const ObjectRecord& record, const ClusterIndex& index, UnitId unit,
                               ByteSpan payload, std::span<const LoadedUnitPtr> parents);

}  // namespace mtdb::internal
