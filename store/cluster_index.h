// SPDX-License-Identifier: Apache-2.0
// ClusterIndex: the cluster DAG of an object. Small: some 90 bytes a cluster of a few thousand
// nodes. Resident while the object is open; or its rows come as they are needed. Layout in
// store/FORMAT.md.
#pragma once

#include <atomic>
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

// Rows that are there do not change; safe for many threads beside one that puts rows.
class ClusterIndex {
 public:
  // Clusters are the units 0 .. cluster_count() - 1, pieces of the root those that follow.
  uint32_t unit_count() const { return static_cast<uint32_t>(entries_.size()); }
  uint32_t cluster_count() const { return clusters_; }
  uint32_t root_piece_count() const { return unit_count() - clusters_; }
  uint64_t root_vertices() const { return root_vertices_; }

  // Whether the unit's row is there; what follows is for those. True for all of a resident index.
  bool Has(UnitId id) const { return late_.empty() || late_[id].there.load(); }

  const UnitEntry& unit(UnitId id) const { return entries_[id]; }
  const PayloadLocation& location(UnitId id) const { return locations_[id]; }
  // Clusters that consume out-triangles of `id`; ascending, each smaller than `id`.
  std::span<const UnitId> children(UnitId id) const {
    return late_.empty() ? Range(children_, child_begin_, id) : late_[id].children;
  }
  // Units whose out-triangles `id` consumes; ascending, each larger than `id`.
  std::span<const UnitId> parents(UnitId id) const {
    return late_.empty() ? Range(parents_, parent_begin_, id) : late_[id].parents;
  }
  // The largest error code of its children; 0 without any.
  uint8_t error_code_below(UnitId id) const { return error_codes_below_[id]; }
  // VertexIndex of the unit's node 0.
  VertexIndex first_vertex(UnitId id) const { return first_vertex_[id]; }

  // Appends; children are added before, and clusters before pieces of the root. Finish() then
  // derives parents and numbering.
  void Add(const UnitEntry& entry, const PayloadLocation& location,
           std::span<const UnitId> children);
  void Finish(uint64_t root_vertices);

  // An index without rows, which are put in any order. The caller has checked them: children are
  // below the unit, and so on, as Add demands.
  ClusterIndex(uint32_t clusters, uint32_t root_pieces, uint64_t root_vertices);
  ClusterIndex() = default;
  void Put(UnitId id, const UnitEntry& entry, const PayloadLocation& location,
           VertexIndex first_vertex, std::span<const UnitId> children,
           std::span<const UnitId> parents, uint8_t error_code_below);

 private:
  // A row's arcs, of an index whose rows come late.
  struct LateRow {
    // A flag that is set once, after the row was written. Copies are for one thread.
    struct Flag {
      std::atomic<bool> value{false};
      Flag() = default;
      Flag(const Flag& o) : value(o.load()) {}
      Flag& operator=(const Flag& o) {
        value.store(o.load());
        return *this;
      }
      bool load() const { return value.load(std::memory_order_acquire); }
    };
    std::vector<UnitId> children, parents;
    Flag there;
  };

  static std::span<const UnitId> Range(const std::vector<UnitId>& values,
                                       const std::vector<uint64_t>& begin, UnitId id) {
    return std::span(values).subspan(begin[id], begin[id + 1] - begin[id]);
  }

  std::vector<UnitEntry> entries_;
  std::vector<PayloadLocation> locations_;
  std::vector<uint8_t> error_codes_below_;
  std::vector<UnitId> children_, parents_;
  std::vector<uint64_t> child_begin_{0}, parent_begin_;
  std::vector<VertexIndex> first_vertex_;
  std::vector<LateRow> late_;
  uint32_t clusters_ = 0;
  uint64_t root_vertices_ = 0;
};

}  // namespace mtdb
