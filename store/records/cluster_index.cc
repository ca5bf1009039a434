// SPDX-License-Identifier: Apache-2.0
#include "store/cluster_index.h"

#include <algorithm>

#include "store/base/check.h"

namespace mtdb {

void ClusterIndex::Add(const UnitEntry& entry, const PayloadLocation& location,
                       std::span<const UnitId> children) {
  uint8_t below = 0;
  for (size_t i = 0; i < children.size(); ++i) {
    MTDB_CHECK(children[i] < clusters_, "a child is added before its parent");
    MTDB_CHECK(i == 0 || children[i - 1] < children[i], "children ascend");
    below = std::max(below, entries_[children[i]].error_code_max);
  }
  if (entry.nodes > 0) {
    MTDB_CHECK(clusters_ == entries_.size(), "clusters come before pieces of the root");
    ++clusters_;
  }
  entries_.push_back(entry);
  locations_.push_back(location);
  error_codes_below_.push_back(below);
  children_.insert(children_.end(), children.begin(), children.end());
  child_begin_.push_back(children_.size());
}

void ClusterIndex::Finish(uint64_t root_vertices) {
  root_vertices_ = root_vertices;
  parent_begin_.assign(entries_.size() + 1, 0);
  for (const UnitId c : children_) ++parent_begin_[c + 1];
  for (size_t i = 1; i < parent_begin_.size(); ++i) parent_begin_[i] += parent_begin_[i - 1];
  parents_.resize(children_.size());
  std::vector<uint64_t> next(parent_begin_.begin(), parent_begin_.end() - 1);
  for (UnitId p = 0; p < entries_.size(); ++p) {
    for (const UnitId c : this->children(p)) parents_[next[c]++] = p;
  }
  first_vertex_.resize(entries_.size());
  VertexIndex vertex = root_vertices;
  for (size_t i = 0; i < entries_.size(); ++i) {
    first_vertex_[i] = vertex;
    vertex += entries_[i].nodes;
  }
}

ClusterIndex::ClusterIndex(uint32_t clusters, uint32_t root_pieces, uint64_t root_vertices)
    : entries_(clusters + root_pieces),
      locations_(entries_.size()),
      error_codes_below_(entries_.size()),
      first_vertex_(entries_.size()),
      late_(entries_.size()),
      clusters_(clusters),
      root_vertices_(root_vertices) {}

void ClusterIndex::Put(UnitId id, const UnitEntry& entry, const PayloadLocation& location,
                       VertexIndex first_vertex, std::span<const UnitId> children,
                       std::span<const UnitId> parents, uint8_t error_code_below) {
  MTDB_CHECK(id < late_.size(), "no such unit");
  if (Has(id)) return;
  MTDB_CHECK((entry.nodes > 0) == (id < clusters_), "clusters have nodes");
  LateRow& row = late_[id];
  entries_[id] = entry;
  locations_[id] = location;
  first_vertex_[id] = first_vertex;
  error_codes_below_[id] = error_code_below;
  row.children.assign(children.begin(), children.end());
  row.parents.assign(parents.begin(), parents.end());
  row.there.value.store(true, std::memory_order_release);
}

}  // namespace mtdb
