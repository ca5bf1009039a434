// SegmentTree: the segments of a line, found by place.
#pragma once

#include <array>
#include <utility>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb {

// Boxes around runs of neighbours, halved again and again: neighbours on a line are near each
// other. Immutable; safe for many threads.
class SegmentTree {
 public:
  using Segment = std::array<Vec3d, 2>;

  explicit SegmentTree(std::vector<Segment> segments) : segments_(std::move(segments)) {
    if (!segments_.empty()) Build(0, 0, segments_.size());
  }

  // True when `visit` is true of a segment. Visits those in boxes of which `enter` is true.
  template <typename Enter, typename Visit>
  bool AnyOf(Enter&& enter, Visit&& visit) const {
    return !segments_.empty() && AnyOf(enter, visit, 0, 0, segments_.size());
  }

  size_t size() const { return segments_.size(); }
  // Around all of them.
  Box3d bounds() const { return segments_.empty() ? Box3d{} : boxes_[0]; }

 private:
  static constexpr size_t kLeaf = 4;

  void Build(size_t node, size_t begin, size_t end) {
    if (boxes_.size() <= node) boxes_.resize(node + 1);
    if (end - begin <= kLeaf) {
      for (size_t i = begin; i < end; ++i) {
        for (const Vec3d& p : segments_[i]) boxes_[node].Add(p);
      }
      return;
    }
    const size_t middle = begin + (end - begin) / 2;
    Build(2 * node + 1, begin, middle);
    Build(2 * node + 2, middle, end);
    Box3d both = boxes_[2 * node + 1];
    both.Add(boxes_[2 * node + 2]);
    boxes_[node] = both;
  }

  template <typename Enter, typename Visit>
  bool AnyOf(Enter& enter, Visit& visit, size_t node, size_t begin, size_t end) const {
    if (!enter(boxes_[node])) return false;
    if (end - begin <= kLeaf) {
      for (size_t i = begin; i < end; ++i) {
        if (visit(segments_[i])) return true;
      }
      return false;
    }
    const size_t middle = begin + (end - begin) / 2;
    return AnyOf(enter, visit, 2 * node + 1, begin, middle) ||
           AnyOf(enter, visit, 2 * node + 2, middle, end);
  }

  std::vector<Segment> segments_;
  std::vector<Box3d> boxes_;  // of node i's halves: 2 i + 1 and 2 i + 2
};

}  // namespace mtdb
