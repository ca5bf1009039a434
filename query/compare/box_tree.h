// SPDX-License-Identifier: Apache-2.0
// BoxTree: boxes in a hierarchy, for questions about near ones.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb::internal {

// A binary tree whose leaves hold up to kLeaf boxes each. The boxes get places: those of a leaf are
// neighbours. Immutable; safe for many threads.
class BoxTree {
 public:
  static constexpr uint32_t kLeaf = 4;

  // Halves the boxes at the median of their centres, again and again, across the longest axis.
  explicit BoxTree(std::span<const Box3d> boxes);

  bool empty() const { return nodes_.empty(); }
  // By place, the number of the box that was given.
  const std::vector<uint32_t>& order() const { return order_; }

  // Calls visit(first, last) for ranges of places, near ones first, while distance2(box around
  // them) is below `limit2`, which visit may lower.
  template <typename Distance2, typename Visit>
  void VisitNear(const Distance2& distance2, const double& limit2, Visit&& visit) const {
    if (nodes_.empty()) return;
    std::array<std::pair<double, uint32_t>, kMaxDepth> stack;
    size_t size = 0;
    stack[size++] = {distance2(nodes_[0].box), 0};
    while (size > 0) {
      const auto [d2, i] = stack[--size];
      if (d2 >= limit2) continue;
      const Node& node = nodes_[i];
      if (node.right == 0) {
        visit(node.first, node.last);
        continue;
      }
      std::pair<double, uint32_t> near{distance2(nodes_[i + 1].box), i + 1};
      std::pair<double, uint32_t> far{distance2(nodes_[node.right].box), node.right};
      if (far.first < near.first) std::swap(near, far);
      stack[size++] = far;
      stack[size++] = near;
    }
  }

  // Whether accepts(place) is true of one of the boxes; may_accept(box around several) says no only
  // where it is of none of them.
  template <typename MayAccept, typename Accepts>
  bool Any(const MayAccept& may_accept, const Accepts& accepts) const {
    std::array<uint32_t, kMaxDepth> stack;
    size_t size = 0;
    if (!nodes_.empty()) stack[size++] = 0;
    while (size > 0) {
      const uint32_t i = stack[--size];
      const Node& node = nodes_[i];
      if (!may_accept(node.box)) continue;
      if (node.right != 0) {
        stack[size++] = node.right;
        stack[size++] = i + 1;
        continue;
      }
      for (uint32_t place = node.first; place < node.last; ++place) {
        if (accepts(place)) return true;
      }
    }
    return false;
  }

 private:
  // Halves of 2^32 boxes, and the sibling of each.
  static constexpr size_t kMaxDepth = 68;
  struct Node {
    Box3d box;
    uint32_t first = 0, last = 0;  // places
    uint32_t right = 0;            // its second child, the first one follows it; 0: a leaf
  };
  void Build(std::span<const Box3d> boxes, uint32_t first, uint32_t last);

  std::vector<Node> nodes_;
  std::vector<uint32_t> order_;
};

}  // namespace mtdb::internal
