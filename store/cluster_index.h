// ClusterIndex: the cluster DAG of an object, resident while the object is open. Small: some 90
// bytes a cluster of a few thousand nodes. Layout in store/FORMAT.md.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb {

// What the index says of one cluster, all of it known when the builder has made the cluster.
struct ClusterEntry {
  uint8_t round = 0;           // 1 = finest
  uint64_t hilbert = 0;        // place on the round's curve; ascending with ClusterId in a round
  Box3i bounds;                // grid; every vertex that a node of the cluster touches
  uint32_t nodes = 0;          // > 0
  uint32_t in_triangles = 0;   // consumed from parents and the root
  uint32_t out_triangles = 0;  // left for children and the drain
  uint32_t external_vertices = 0;  // corners of in-triangles
  uint8_t error_code_min = 0;      // over its nodes
  uint8_t error_code_max = 0;
  bool explicit_arcs = false;  // in-triangles coincide on the grid; arcs name their slots
  friend bool operator==(const ClusterEntry&, const ClusterEntry&) = default;
};

// A piece of the root mesh.
struct RootPieceEntry {
  Box3i bounds;
  uint32_t triangles = 0;
  uint32_t vertices = 0;
  friend bool operator==(const RootPieceEntry&, const RootPieceEntry&) = default;
};

// Where a cluster's or root piece's payload lies: a value of the store and a range in it.
struct PayloadLocation {
  uint32_t value = 0;     // number of the value within its table, in key order of writing
  uint32_t offset = 0;    // bytes
  uint32_t length = 0;    // bytes, > 0
  uint64_t checksum = 0;  // of the payload, and of what it is of: store/FORMAT.md, "Index"
  friend bool operator==(const PayloadLocation&, const PayloadLocation&) = default;
};

// Immutable once built; safe for many threads.
class ClusterIndex {
 public:
  uint32_t cluster_count() const { return static_cast<uint32_t>(entries_.size()); }
  uint32_t root_piece_count() const { return static_cast<uint32_t>(root_entries_.size()); }
  uint64_t root_vertices() const { return root_vertices_; }

  const ClusterEntry& cluster(ClusterId id) const { return entries_[id.value]; }
  const RootPieceEntry& root_piece(RootPieceId id) const { return root_entries_[id.value]; }
  const PayloadLocation& location(ClusterId id) const { return locations_[id.value]; }
  const PayloadLocation& location(RootPieceId id) const { return root_locations_[id.value]; }

  // Clusters that consume out-triangles of `id`; ascending, each smaller than `id`.
  std::span<const ClusterId> children(ClusterId id) const {
    return Range(children_, child_begin_, id.value);
  }
  std::span<const ClusterId> children(RootPieceId id) const {
    return Range(root_children_, root_child_begin_, id.value);
  }
  // Clusters and root pieces whose out-triangles `id` consumes; ascending.
  std::span<const ClusterId> parents(ClusterId id) const {
    return Range(parents_, parent_begin_, id.value);
  }
  std::span<const RootPieceId> root_parents(ClusterId id) const {
    return Range(root_parents_, root_parent_begin_, id.value);
  }
  // VertexIndex of the cluster's node 0.
  VertexIndex first_vertex(ClusterId id) const { return first_vertex_[id.value]; }

  // Appends; a child must have been added before. Finish() then derives parents and numbering.
  void AddCluster(const ClusterEntry& entry, const PayloadLocation& location,
                  std::span<const ClusterId> children);
  void AddRootPiece(const RootPieceEntry& entry, const PayloadLocation& location,
                    std::span<const ClusterId> children);
  void Finish(uint64_t root_vertices);

 private:
  template <typename T>
  static std::span<const T> Range(const std::vector<T>& values, const std::vector<uint64_t>& begin,
                                  uint32_t i) {
    return std::span(values).subspan(begin[i], begin[i + 1] - begin[i]);
  }

  std::vector<ClusterEntry> entries_;
  std::vector<PayloadLocation> locations_;
  std::vector<RootPieceEntry> root_entries_;
  std::vector<PayloadLocation> root_locations_;
  std::vector<ClusterId> children_, root_children_, parents_;
  std::vector<RootPieceId> root_parents_;
  std::vector<uint64_t> child_begin_{0}, root_child_begin_{0}, parent_begin_, root_parent_begin_;
  std::vector<VertexIndex> first_vertex_;
  uint64_t root_vertices_ = 0;
};

}  // namespace mtdb
