#include "store/cluster_index.h"

#include "store/base/check.h"

namespace mtdb {

void ClusterIndex::Add(const UnitEntry& entry, const PayloadLocation& location,
                       std::span<const UnitId> children) {
  for (size_t i = 0; i < children.size(); ++i) {
    MTDB_CHECK(children[i] < clusters_, "a child is added before its parent");
    MTDB_CHECK(i == 0 || children[i - 1] < children[i], "children ascend");
  }
  if (entry.nodes > 0) {
    MTDB_CHECK(clusters_ == entries_.size(), "clusters come before pieces of the root");
    ++clusters_;
  }
  entries_.push_back(entry);
  locations_.push_back(location);
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

}  // namespace mtdb
