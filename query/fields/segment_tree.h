// SPDX-License-Identifier: Apache-2.0
// SegmentTree: the segments of a line or polygon, found by place.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "query/fields/rounding.h"
#include "query/fields/work_meter.h"
#include "store/base/geometry.h"

namespace mtdb::internal {

// A k-d tree over segments as points of six coordinates, their middles and half their lengths, so
// that a group lies near one place and in about one direction. Around each group there is a box,
// and a strip: what it covers across its direction. So long segments side by side, as in a comb or
// a star, part as well as short ones. Immutable; safe for many threads. Memory: about 100 bytes a
// segment.
//
// Cost of a question: about logarithmic in the number n of segments where they do not cross; at
// worst about n^(3/4), or all of those that come together in one place, there. Answers are those of
// asking every segment.
class SegmentTree {
 public:
  using Segment = std::array<Vec3d, 2>;

  explicit SegmentTree(std::vector<Segment> segments);

  // True when `visit` is true of a segment. Visits all that are within `distance` of the hull of
  // `points`, and some others.
  template <typename Visit>
  bool AnyNear(std::span<const Vec3d> points, double distance, Visit&& visit) const;
  template <typename Visit>
  bool AnyNear(const Box3d& box, double distance, Visit&& visit) const;

  // Of segments in the plane z = 0: true when a ray from `p` along x crosses an odd number of them.
  bool CrossesOdd(Vec3d p) const;

  size_t size() const { return segments_.size(); }
  // Around all of them.
  Box3d bounds() const { return nodes_.empty() ? Box3d{} : nodes_[0].box; }

 private:
  static constexpr uint32_t kLeaf = 8;
  static constexpr size_t kDeepest = 64;

  struct Node {
    Box3d box;
    // Where all points lie along two directions of length 1 that are about perpendicular to the
    // segments and to each other.
    std::array<Vec3d, 2> across;
    std::array<double, 2> low, high;
    double all_from = 0, all_to = 0;  // each segment crosses every y from all_from to below all_to
    uint32_t begin = 0, end = 0;      // of segments_
    uint32_t right = 0;               // the second half; the first is the next node; 0: a leaf
  };
  // What a question is asked with.
  struct Asked {
    std::span<const Vec3d> points;
    Box3d around;
    double limit;    // of a strip's distance
    double squared;  // of a box's squared distance
  };

  // Visits the segments of all groups that `enter` enters, until one is true: then true. False also
  // when the meter says that the question is to end. There is a group.
  template <typename Enter, typename Visit>
  bool Walk(Enter&& enter, Visit&& visit) const;
  uint32_t Build(uint32_t begin, uint32_t end);
  void Enclose(Node& node) const;
  // By the coordinate that differs most.
  void Halve(uint32_t begin, uint32_t middle, uint32_t end);
  static bool MayBeNear(const Node& node, const Asked& asked);
  static Box3d BoxOf(const Segment& s) {
    Box3d box;
    for (const Vec3d& p : s) box.Add(p);
    return box;
  }

  std::vector<Segment> segments_;
  std::vector<Node> nodes_;
  double scale_ = 0;  // the largest coordinate
};

template <typename Visit>
bool SegmentTree::AnyNear(const Box3d& box, double distance, Visit&& visit) const {
  if (box.empty()) return false;
  std::array<Vec3d, 8> corners;
  for (int i = 0; i < 8; ++i) corners[static_cast<size_t>(i)] = Corner(box, i);
  return AnyNear(corners, distance, visit);
}

template <typename Visit>
bool SegmentTree::AnyNear(std::span<const Vec3d> points, double distance, Visit&& visit) const {
  if (nodes_.empty()) return false;
  Box3d around;
  for (const Vec3d& p : points) around.Add(p);
  Asked asked;
  asked.points = points;
  asked.around = around;
  asked.limit = distance + 4 * Rounding(around, distance, scale_);
  asked.squared = distance * distance * (1 + kBoxRounding);
  return Walk([&](const Node& node) { return MayBeNear(node, asked); },
              [&](const Segment& s) {
                return SquaredDistanceBoxBox(BoxOf(s), around) <= asked.squared && visit(s);
              });
}

template <typename Enter, typename Visit>
bool SegmentTree::Walk(Enter&& enter, Visit&& visit) const {
  WorkMeter* const meter = WorkMeter::Current();
  std::array<uint32_t, kDeepest> open;
  size_t count = 0;
  open[count++] = 0;
  while (count > 0) {
    const uint32_t n = open[--count];
    const Node& node = nodes_[n];
    if (meter != nullptr && !meter->Spend(1)) return false;
    if (!enter(node)) continue;
    if (node.right != 0) {
      open[count++] = node.right;
      open[count++] = n + 1;
      continue;
    }
    if (meter != nullptr && !meter->Spend(node.end - node.begin)) return false;
    for (uint32_t i = node.begin; i < node.end; ++i) {
      if (visit(segments_[i])) return true;
    }
  }
  return false;
}

}  // namespace mtdb::internal
