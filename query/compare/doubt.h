// SPDX-License-Identifier: Apache-2.0
// Where there is doubt: sets of boxes, as regions of queries and as a filter of those who ask.
#pragma once

#include <memory>
#include <vector>

#include "query/compare/box_tree.h"
#include "query/region.h"
#include "store/base/geometry.h"

namespace mtdb::internal {

// The union of boxes. Immutable; safe for many threads.
class BoxSet {
 public:
  explicit BoxSet(std::vector<Box3d> boxes);

  const std::vector<Box3d>& boxes() const { return boxes_; }
  // True when some box is at most `distance` away from `box` along each axis.
  bool Meets(const Box3d& box, double distance) const;

 private:
  BoxTree tree_;
  std::vector<Box3d> boxes_;  // by place
};
using BoxSetPtr = std::shared_ptr<const BoxSet>;

// What is at most `by` away from the boxes along each axis, and some more: it goes by the boxes of
// triangles.
RegionPtr AroundBoxes(BoxSetPtr boxes, double by);

// Which points of a cut whose triangles have bounds of up to `bound` ask.
struct Asking {
  BoxSetPtr boxes;   // null: all of space
  RegionPtr region;  // likewise
  double bound = 0;

  // False only when nothing that asks is what the part stands for.
  bool Meets(const Triangle3d& part) const;
  // True only when all that the point stands for asks.
  bool Covers(Vec3d point) const;
};

}  // namespace mtdb::internal
