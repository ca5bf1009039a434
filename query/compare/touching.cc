// SPDX-License-Identifier: Apache-2.0
#include "query/compare/touching.h"

#include <algorithm>
#include <numeric>

#include "query/compare/box_tree.h"

namespace mtdb::internal {
namespace {

bool Meet(const Box3d& a, const Box3d& b) {
  for (int i = 0; i < 3; ++i) {
    if (a.min[i] > b.max[i] || b.min[i] > a.max[i]) return false;
  }
  return true;
}

// Sets of numbers, each with its least member as its name.
class Groups {
 public:
  explicit Groups(size_t count) : parents_(count) {
    std::iota(parents_.begin(), parents_.end(), 0U);
  }
  uint32_t Of(uint32_t i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }
  void Unite(uint32_t a, uint32_t b) {
    a = Of(a);
    b = Of(b);
    parents_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<uint32_t> parents_;
};

}  // namespace

std::vector<uint32_t> TouchingGroups(std::span<const Box3d> boxes) {
  const BoxTree tree(boxes);
  Groups groups(boxes.size());
  for (uint32_t i = 0; i < boxes.size(); ++i) {
    tree.Any([&](const Box3d& node) { return Meet(node, boxes[i]); },
             [&](uint32_t place) {
               const uint32_t other = tree.order()[place];
               if (Meet(boxes[i], boxes[other])) groups.Unite(i, other);
               return false;
             });
  }
  std::vector<uint32_t> names(boxes.size());
  for (uint32_t i = 0; i < boxes.size(); ++i) names[i] = groups.Of(i);
  return names;
}

}  // namespace mtdb::internal
