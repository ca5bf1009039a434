// SPDX-License-Identifier: Apache-2.0
#include "query/fields/segment_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace mtdb::internal {
namespace {

// The same for a segment and its reverse.
Vec3d HalfOf(const SegmentTree::Segment& s) {
  const Vec3d half = (s[1] - s[0]) * 0.5;
  return half < Vec3d{} ? half * -1.0 : half;
}
// Twice the middle, and the half in the same measure: differences of either move an end as far.
double Coordinate(const SegmentTree::Segment& s, int axis) {
  return axis < 3 ? (s[0][axis] + s[1][axis]) * 0.5 : HalfOf(s)[axis - 3];
}

// Of length 1 and perpendicular to `along`, in the plane z = 0 if that can be; and to both.
std::array<Vec3d, 2> Across(Vec3d along) {
  const double flat = std::hypot(along.x, along.y);
  const Vec3d first = flat > 0 ? Vec3d{-along.y / flat, along.x / flat, 0} : Vec3d{1, 0, 0};
  const double length = Length(along);
  const Vec3d second = length > 0 ? Cross(along * (1 / length), first) : Vec3d{0, 0, 1};
  return {first, second};
}

}  // namespace

SegmentTree::SegmentTree(std::vector<Segment> segments) : segments_(std::move(segments)) {
  for (const Segment& s : segments_) {
    for (const Vec3d& p : s) scale_ = std::max(scale_, LargestCoordinate(p));
  }
  if (segments_.empty()) return;
  nodes_.reserve(4 * segments_.size() / kLeaf + 1);
  Build(0, static_cast<uint32_t>(segments_.size()));
}

uint32_t SegmentTree::Build(uint32_t begin, uint32_t end) {
  const auto n = static_cast<uint32_t>(nodes_.size());
  Node node;
  node.begin = begin;
  node.end = end;
  Enclose(node);
  nodes_.push_back(node);
  if (end - begin <= kLeaf) return n;
  const uint32_t middle = begin + (end - begin) / 2;
  Halve(begin, middle, end);
  Build(begin, middle);
  const uint32_t right = Build(middle, end);
  nodes_[n].right = right;
  return n;
}

void SegmentTree::Enclose(Node& node) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  node.all_from = -kInfinity;
  node.all_to = kInfinity;
  Vec3d along;
  for (uint32_t i = node.begin; i < node.end; ++i) {
    const Segment& s = segments_[i];
    const Box3d box = BoxOf(s);
    node.box.Add(box);
    node.all_from = std::max(node.all_from, box.min.y);
    node.all_to = std::min(node.all_to, box.max.y);
    along += HalfOf(s);
  }
  node.across = Across(along);
  node.low.fill(kInfinity);
  node.high.fill(-kInfinity);
  for (uint32_t i = node.begin; i < node.end; ++i) {
    for (const Vec3d& p : segments_[i]) {
      for (size_t k = 0; k < 2; ++k) {
        const double at = Dot(p, node.across[k]);
        node.low[k] = std::min(node.low[k], at);
        node.high[k] = std::max(node.high[k], at);
      }
    }
  }
}

void SegmentTree::Halve(uint32_t begin, uint32_t middle, uint32_t end) {
  int widest = 0;
  double width = -1;
  for (int axis = 0; axis < 6; ++axis) {
    double low = Coordinate(segments_[begin], axis);
    double high = low;
    for (uint32_t i = begin + 1; i < end; ++i) {
      const double at = Coordinate(segments_[i], axis);
      low = std::min(low, at);
      high = std::max(high, at);
    }
    if (high - low <= width) continue;
    width = high - low;
    widest = axis;
  }
  const auto first = segments_.begin();
  std::nth_element(first + begin, first + middle, first + end,
                   [&](const Segment& a, const Segment& b) {
                     return Coordinate(a, widest) < Coordinate(b, widest);
                   });
}

bool SegmentTree::MayBeNear(const Node& node, const Asked& asked) {
  if (SquaredDistanceBoxBox(node.box, asked.around) > asked.squared) return false;
  double squared = 0;
  for (size_t k = 0; k < 2; ++k) {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (const Vec3d& p : asked.points) {
      const double at = Dot(p, node.across[k]);
      low = std::min(low, at);
      high = std::max(high, at);
    }
    const double gap = std::max({low - node.high[k], node.low[k] - high, 0.0});
    squared += gap * gap;
  }
  return !(squared > asked.limit * asked.limit);
}

// Groups that the ray crosses as a whole, or misses, need no look at their segments.
bool SegmentTree::CrossesOdd(Vec3d p) const {
  if (nodes_.empty()) return false;
  const double slack = 4 * kBoxRounding * std::max(scale_, LargestCoordinate(p));
  uint32_t crossings = 0;
  const auto enter = [&](const Node& node) {
    if (!(node.box.min.y <= p.y && p.y < node.box.max.y)) return false;
    if (p.x > node.box.max.x + slack) return false;
    // On which side of all lines p is, as the first strip tells.
    const double across = node.across[0].x;
    const double at = Dot(p, node.across[0]);
    const bool below = at < node.low[0] - slack;
    const bool above = at > node.high[0] + slack;
    if (across > 0 ? above : (across < 0 && below)) return false;
    if (node.all_from <= p.y && p.y < node.all_to) {
      const bool before = across > 0 ? below : (across < 0 && above);
      if (before || p.x < node.box.min.x - slack) {
        crossings += node.end - node.begin;
        return false;
      }
    }
    return true;
  };
  Walk(enter, [&](const Segment& s) {
    const auto& [a, b] = s;
    if ((a.y > p.y) != (b.y > p.y) && p.x - a.x < (p.y - a.y) * ((b.x - a.x) / (b.y - a.y))) {
      ++crossings;
    }
    return false;
  });
  return crossings % 2 != 0;
}

}  // namespace mtdb::internal
