// ClusterIndex: the cluster DAG of an object, resident while the object is open. Small: some 90
// bytes a cluster of a few thousand nodes. Layout in store/FORMAT.md.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb {

// The round of the root's pieces.
inline constexpr uint8_t kRootRound = 255;

// What the index says of one unit, all of it known when the builder has made it.
struct UnitEntry {
  uint8_t round = 0;               // 1 = finest
  uint64_t hilbert = 0;            // place on the round's curve; ascending with UnitId in a round
  Box3i bounds;                    // grid; every vertex that the unit touches
  uint32_t nodes = 0;              // 0 in the root's round only
  uint32_t in_triangles = 0;       // consumed from parents
  uint32_t out_triangles = 0;      // left for children and the drain
  uint32_t external_vertices = 0;  // that no node inserts: corners of in-triangles, or of the root
  uint8_t error_code_min = 0;      // over its nodes
  uint8_t error_code_max = 0;
  bool explicit_arcs = false;  // in-triangles coincide on the grid; arcs name their slots
  friend bool operator==(const UnitEntry&, const UnitEntry&) = default;
};

// Where a unit's payload lies: a value of the store and a range in it.
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
  // Clusters are the units 0 .. cluster_count() - 1, pieces of the root those that follow.
  uint32_t unit_count() const { return static_cast<uint32_t>(entries_.size()); }
  uint32_t cluster_count() const { return clusters_; }
  uint32_t root_piece_count() const { return unit_count() - clusters_; }
  uint64_t root_vertices() const { return root_vertices_; }

  const UnitEntry& unit(UnitId id) const { return entries_[id]; }
  const PayloadLocation& location(UnitId id) const { return locations_[id]; }
  // Clusters that consume out-triangles of `id`; ascending, each smaller than `id`.
  std::span<const UnitId> children(UnitId id) const { return Range(children_, child_begin_, id); }
  // Units whose out-triangles `id` consumes; ascending, each larger than `id`.
  std::span<const UnitId> parents(UnitId id) const { return Range(parents_, parent_begin_, id); }
  // VertexIndex of the unit's node 0.
  VertexIndex first_vertex(UnitId id) const { return first_vertex_[id]; }

  // Appends; children are added before, and clusters before pieces of the root. Finish() then
  // derives parents and numbering.
  void Add(const UnitEntry& entry, const PayloadLocation& location,
           std::span<const UnitId> children);
  void Finish(uint64_t root_vertices);

 private:
  static std::span<const UnitId> Range(const std::vector<UnitId>& values,
                                       const std::vector<uint64_t>& begin, UnitId id) {
    return std::span(values).subspan(begin[id], begin[id + 1] - begin[id]);
  }

  std::vector<UnitEntry> entries_;
  std::vector<PayloadLocation> locations_;
  std::vector<UnitId> children_, parents_;
  std::vector<uint64_t> child_begin_{0}, parent_begin_;
  std::vector<VertexIndex> first_vertex_;
  uint32_t clusters_ = 0;
  uint64_t root_vertices_ = 0;
};

}  // namespace mtdb
