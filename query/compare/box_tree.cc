// SPDX-License-Identifier: Apache-2.0
#include "query/compare/box_tree.h"

#include <algorithm>
#include <numeric>

namespace mtdb::internal {

BoxTree::BoxTree(std::span<const Box3d> boxes) : order_(boxes.size()) {
  std::iota(order_.begin(), order_.end(), 0U);
  if (!boxes.empty()) Build(boxes, 0, static_cast<uint32_t>(boxes.size()));
}

void BoxTree::Build(std::span<const Box3d> boxes, uint32_t first, uint32_t last) {
  const size_t self = nodes_.size();
  Node node{{}, first, last, 0};
  Box3d centres;  // twice
  for (uint32_t i = first; i < last; ++i) {
    const Box3d& box = boxes[order_[i]];
    node.box.Add(box);
    centres.Add(box.min + box.max);
  }
  nodes_.push_back(node);
  if (last - first <= kLeaf) return;
  const Vec3d size = centres.max - centres.min;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const uint32_t middle = first + (last - first) / 2;
  std::nth_element(order_.begin() + first, order_.begin() + middle, order_.begin() + last,
                   [&](uint32_t a, uint32_t b) {
                     return boxes[a].min[axis] + boxes[a].max[axis] <
                            boxes[b].min[axis] + boxes[b].max[axis];
                   });
  Build(boxes, first, middle);
  nodes_[self].right = static_cast<uint32_t>(nodes_.size());
  Build(boxes, middle, last);
}

}  // namespace mtdb::internal
