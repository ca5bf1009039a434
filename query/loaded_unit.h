// LoadedUnit: a decoded cluster or root piece, and where its in-triangles come from.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "codecs/cluster/cluster.h"
#include "store/base/attributes.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/object_record.h"

namespace mtdb {

// Clusters and root pieces numbered together: cluster c is unit c, root piece r is unit
// cluster_count + r. A unit's parents have larger numbers than itself.
using UnitId = uint32_t;

// What an in-triangle of a cluster is to the unit that creates it.
struct SlotOrigin {
  uint32_t parent = 0;   // ordinal in LoadedUnit::parents
  uint32_t slot = 0;     // of the parent
  uint32_t creator = 0;  // node of the parent; kNone32 when the parent is a root piece
};

// How a surface keeps clusters in memory between queries.
enum class RuntimeForm : uint8_t {
  kExplicit,  // decoded, as LoadedUnit: holes, stars, arcs are listed
  kImplicit,  // as in the store: a query decodes what it needs, again
};

// Immutable once loaded; safe for many threads.
struct LoadedUnit {
  UnitId id = 0;
  bool is_root = false;
  Cluster cluster;                  // when not is_root
  RootPiece piece;                  // when is_root
  std::vector<UnitId> parents;      // root pieces ascending, then clusters ascending
  std::vector<SlotOrigin> origins;  // per in-triangle
  std::vector<uint32_t> by_origin;  // in-slots, ascending by their origin's parent and slot
  std::vector<UnitId> owners;       // per external vertex: the cluster that inserts it, or kNone32
  std::vector<uint64_t> drain;      // a bit per own slot: part of the full-resolution mesh
  std::vector<NodeIndex> creators;  // of every kCreatorStep-th own slot, for creator()

  const std::vector<uint32_t>& removers() const {
    return is_root ? piece.removers : cluster.removers;
  }
  const std::vector<ClusterId>& children() const {
    return is_root ? piece.children : cluster.children;
  }
  const std::vector<ExplicitArc>& explicit_arcs() const {
    return is_root ? piece.explicit_arcs : cluster.explicit_arcs;
  }
  const std::vector<Vec3i>& positions() const {
    return is_root ? piece.positions : cluster.in.positions;
  }
  const Bytes& rows() const { return is_root ? piece.rows : cluster.in.rows; }
  // Of a local vertex that the unit does not insert: its number in the object, and the cluster that
  // inserts it, or kNone32.
  VertexIndex vertex(uint32_t local) const {
    return is_root ? piece.vertices[local] : cluster.in.vertices[local];
  }
  UnitId owner(uint32_t local) const { return is_root ? kNone32 : owners[local]; }
  uint32_t nodes() const { return is_root ? 0 : cluster.nodes(); }
  // Slots below this one are in-triangles; the unit creates the others.
  uint32_t first_own_slot() const { return is_root ? 0 : cluster.in_triangles(); }
  uint32_t own_slots() const { return static_cast<uint32_t>(removers().size()) - first_own_slot(); }
  // The node that creates a slot >= first_own_slot() of a cluster.
  NodeIndex creator(uint32_t slot) const {
    NodeIndex node = creators[(slot - first_own_slot()) / kCreatorStep];
    while (cluster.star_begin[node + 1] <= slot) ++node;
    return node;
  }
  // The in-slot that a parent's slot arrives at, or kNone32.
  uint32_t FindInSlot(UnitId parent, uint32_t parent_slot) const;
  // Local vertices of any slot; `creator` as given by creator(), unused for other slots.
  std::array<uint32_t, 3> corners(uint32_t slot, NodeIndex creator_node) const {
    if (is_root) return piece.triangles[slot];
    if (slot < cluster.in_triangles()) return cluster.in.triangles[slot];
    return cluster.star_triangle(creator_node, slot);
  }
  size_t memory_bytes() const;

  static constexpr uint32_t kCreatorStep = 16;
};

using LoadedUnitPtr = std::shared_ptr<const LoadedUnit>;

// Number of units of an index, and how they map to clusters and root pieces.
inline uint32_t UnitCount(const ClusterIndex& index) {
  return index.cluster_count() + index.root_piece_count();
}
inline bool IsRootUnit(const ClusterIndex& index, UnitId unit) {
  return unit >= index.cluster_count();
}
// The parents of a unit, in the order of LoadedUnit::parents.
std::vector<UnitId> UnitParents(const ClusterIndex& index, UnitId unit);
// "scan: cluster 12" or "scan: root piece 0", for messages.
std::string UnitName(const ObjectRecord& record, UnitId unit);

// Decodes a unit from its payload and its decoded parents (as UnitParents lists them). Every
// disagreement of payload, parents and index is kCorrupt.
Result<LoadedUnitPtr> LoadUnit(const ObjectRecord& record, const ClusterIndex& index, UnitId unit,
                               ByteSpan payload, std::span<const LoadedUnitPtr> parents);

}  // namespace mtdb
