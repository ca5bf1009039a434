#include "store/cluster_index.h"

#include "store/base/check.h"

namespace mtdb {
namespace {

// Turns counts per slot, begin[i + 1] = count of i, into offsets.
void Accumulate(std::vector<uint64_t>* begin) {
  for (size_t i = 1; i < begin->size(); ++i) (*begin)[i] += (*begin)[i - 1];
}

// Inverts the lists `children` of `from` parents into the lists of each child's parents, ascending.
template <typename Parent>
void Invert(const std::vector<ClusterId>& children, const std::vector<uint64_t>& child_begin,
            size_t clusters, std::vector<Parent>* parents, std::vector<uint64_t>* parent_begin) {
  parent_begin->assign(clusters + 1, 0);
  for (const ClusterId c : children) ++(*parent_begin)[c.value + 1];
  Accumulate(parent_begin);
  parents->resize(children.size());
  std::vector<uint64_t> next(parent_begin->begin(), parent_begin->end() - 1);
  for (uint32_t p = 0; p + 1 < child_begin.size(); ++p) {
    for (uint64_t i = child_begin[p]; i < child_begin[p + 1]; ++i) {
      (*parents)[next[children[i].value]++] = Parent{p};
    }
  }
}

}  // namespace

void ClusterIndex::AddCluster(const ClusterEntry& entry, const PayloadLocation& location,
                              std::span<const ClusterId> children) {
  for (size_t i = 0; i < children.size(); ++i) {
    MTDB_CHECK(children[i].value < entries_.size(), "a child is added before its parent");
    MTDB_CHECK(i == 0 || children[i - 1] < children[i], "children ascend");
  }
  entries_.push_back(entry);
  locations_.push_back(location);
  children_.insert(children_.end(), children.begin(), children.end());
  child_begin_.push_back(children_.size());
}

void ClusterIndex::AddRootPiece(const RootPieceEntry& entry, const PayloadLocation& location,
                                std::span<const ClusterId> children) {
  for (size_t i = 0; i < children.size(); ++i) {
    MTDB_CHECK(children[i].value < entries_.size(), "a child is added before its parent");
    MTDB_CHECK(i == 0 || children[i - 1] < children[i], "children ascend");
  }
  root_entries_.push_back(entry);
  root_locations_.push_back(location);
  root_children_.insert(root_children_.end(), children.begin(), children.end());
  root_child_begin_.push_back(root_children_.size());
}

void ClusterIndex::Finish(uint64_t root_vertices) {
  root_vertices_ = root_vertices;
  Invert(children_, child_begin_, entries_.size(), &parents_, &parent_begin_);
  Invert(root_children_, root_child_begin_, entries_.size(), &root_parents_, &root_parent_begin_);
  first_vertex_.resize(entries_.size());
  VertexIndex next = root_vertices;
  for (size_t i = 0; i < entries_.size(); ++i) {
    first_vertex_[i] = next;
    next += entries_[i].nodes;
  }
}

}  // namespace mtdb
