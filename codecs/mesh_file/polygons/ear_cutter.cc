// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/polygons/ear_cutter.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mtdb::internal {
namespace {

constexpr uint32_t kLeaf = 8;  // corners of a leaf at most
// Triangles without area are cut off only where there is no ear: two corners at one place, or an
// edge that runs back, before corners on a line.
constexpr double kFoldedLast = -1;
constexpr double kFoldedFirst = 2;
constexpr double kStraight = -2;
// Steps of the search: many times what simple polygons take (a spiral of 100,000 corners: some 300
// a corner).
constexpr uint64_t kWorkPerCorner = 2000;
constexpr uint64_t kLeastWork = uint64_t{1} << 20;

double SquaredDistance(PlanePoint a, PlanePoint b) {
  return (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y);
}

// Whether the whole box lies to the right of the line ab, for certain.
bool IsRightOf(PlanePoint a, PlanePoint b, PlanePoint least, PlanePoint most) {
  constexpr double kSafety = 16 * std::numeric_limits<double>::epsilon();
  const double dx = b.x - a.x, dy = b.y - a.y;
  const double x = dy < 0 ? most.x : least.x;
  const double y = dx > 0 ? most.y : least.y;
  const double left = dx * (y - a.y), right = dy * (x - a.x);
  return left - right < -kSafety * (std::abs(left) + std::abs(right));
}

}  // namespace

int EarCutter::TurnAt(uint32_t corner) const {
  const Corner& b = corners_[corner];
  return TurnOf(points_[b.before], points_[corner], points_[b.after]);
}

bool EarCutter::Cut(std::span<const PlanePoint> points, bool folds_first,
                    std::vector<std::array<uint32_t, 3>>* triangles) {
  points_ = points;
  triangles->clear();
  folded_ = folds_first ? kFoldedFirst : kFoldedLast;
  const auto count = static_cast<uint32_t>(points.size());
  corners_.assign(count, {});
  for (uint32_t i = 0; i < count; ++i) {
    corners_[i].before = i == 0 ? count - 1 : i - 1;
    corners_[i].after = i + 1 == count ? 0 : i + 1;
  }
  work_ = 0;
  most_work_ = kWorkPerCorner * count + kLeastWork;
  queue_ = {};
  BuildTree();
  for (uint32_t i = 0; i < count; ++i) Consider(i);
  uint32_t left = count;
  bool again = false;  // corners that were no ears may have become some
  while (left > 3) {
    if (work_ > most_work_) return false;
    if (queue_.empty()) {
      if (!again) return false;
      again = false;
      for (uint32_t i = 0; i < count; ++i) {
        if (!corners_[i].is_cut) Consider(i);
      }
      continue;
    }
    const Candidate next = queue_.top();
    queue_.pop();
    const Corner& corner = corners_[next.corner];
    if (corner.is_cut || corner.version != next.version) continue;
    again = again || next.quality == folded_ || next.quality == kStraight;
    CutOff(next.corner, triangles);
    --left;
  }
  uint32_t last = 0;
  while (corners_[last].is_cut) ++last;
  if (TurnAt(last) < 0) return false;
  CutOff(last, triangles);
  return true;
}

void EarCutter::CutOff(uint32_t corner, std::vector<std::array<uint32_t, 3>>* triangles) {
  Corner& b = corners_[corner];
  triangles->push_back({b.before, corner, b.after});
  b.is_cut = true;
  if (b.in_tree) RemoveFromTree(corner);
  corners_[b.before].after = b.after;
  corners_[b.after].before = b.before;
  for (const uint32_t neighbour : {b.before, b.after}) {
    ++corners_[neighbour].version;
    if (corners_[neighbour].in_tree && TurnAt(neighbour) > 0) RemoveFromTree(neighbour);
  }
  Consider(b.before);
  Consider(b.after);
}

void EarCutter::Consider(uint32_t corner) {
  const Corner& b = corners_[corner];
  const Ear ear{b.before, corner, b.after, points_[b.before], points_[corner], points_[b.after]};
  const int turn = TurnOf(ear.pa, ear.pb, ear.pc);
  if (turn < 0) return;
  double quality = kStraight;
  if (turn > 0) {
    if (!IsEar(ear)) return;
    quality = QualityOf(ear);
  } else {
    const double along = (ear.pb.x - ear.pa.x) * (ear.pc.x - ear.pb.x) +
                         (ear.pb.y - ear.pa.y) * (ear.pc.y - ear.pb.y);
    if (!(along > 0)) quality = folded_;
  }
  queue_.push({quality, corner, b.version});
}

// Twice the area by the square of the longest edge.
double EarCutter::QualityOf(const Ear& ear) const {
  const double area =
      (ear.pb.x - ear.pa.x) * (ear.pc.y - ear.pa.y) - (ear.pb.y - ear.pa.y) * (ear.pc.x - ear.pa.x);
  const double longest = std::max({SquaredDistance(ear.pa, ear.pb), SquaredDistance(ear.pb, ear.pc),
                                   SquaredDistance(ear.pc, ear.pa)});
  return longest > 0 ? std::max(area / longest, 0.0) : 0;
}

bool EarCutter::IsEar(const Ear& ear) {
  // What comes before and after must not lead into the triangle.
  const PlanePoint before = points_[corners_[ear.a].before];
  if (TurnOf(ear.pa, ear.pb, before) > 0 && TurnOf(ear.pc, ear.pa, before) > 0) return false;
  const PlanePoint after = points_[corners_[ear.c].after];
  if (TurnOf(ear.pb, ear.pc, after) > 0 && TurnOf(ear.pc, ear.pa, after) > 0) return false;
  return !AnyBlocks(ear);
}

// A corner in the triangle blocks it; on its border only where an edge leads from there into the
// triangle, or where the border is the new edge.
bool EarCutter::Blocks(const Ear& ear, uint32_t corner) const {
  if (corner == ear.a || corner == ear.b || corner == ear.c) return false;
  const PlanePoint p = points_[corner];
  const int ab = TurnOf(ear.pa, ear.pb, p);
  if (ab < 0) return false;
  const int bc = TurnOf(ear.pb, ear.pc, p);
  if (bc < 0) return false;
  const int ca = TurnOf(ear.pc, ear.pa, p);
  if (ca < 0) return false;
  if (ab > 0 && bc > 0) return true;  // inside, or on the new edge
  for (const uint32_t neighbour : {corners_[corner].before, corners_[corner].after}) {
    const PlanePoint q = points_[neighbour];
    if ((ab > 0 || TurnOf(ear.pa, ear.pb, q) > 0) && (bc > 0 || TurnOf(ear.pb, ear.pc, q) > 0) &&
        (ca > 0 || TurnOf(ear.pc, ear.pa, q) > 0)) {
      return true;
    }
  }
  return false;
}

bool EarCutter::MayHold(const Ear& ear, const TreeNode& node) {
  const auto [least_x, most_x] = std::minmax({ear.pa.x, ear.pb.x, ear.pc.x});
  const auto [least_y, most_y] = std::minmax({ear.pa.y, ear.pb.y, ear.pc.y});
  if (node.most.x < least_x || node.least.x > most_x || node.most.y < least_y ||
      node.least.y > most_y) {
    return false;
  }
  return !IsRightOf(ear.pa, ear.pb, node.least, node.most) &&
         !IsRightOf(ear.pb, ear.pc, node.least, node.most) &&
         !IsRightOf(ear.pc, ear.pa, node.least, node.most);
}

bool EarCutter::AnyBlocks(const Ear& ear) {
  if (tree_.empty()) return false;
  stack_.assign(1, 0);
  while (!stack_.empty()) {
    const TreeNode& node = tree_[stack_.back()];
    stack_.pop_back();
    ++work_;
    if (node.left == 0 || !MayHold(ear, node)) continue;
    if (node.children[0] != 0) {
      stack_.insert(stack_.end(), {node.children[0], node.children[1]});
      continue;
    }
    work_ += node.end - node.begin;
    for (uint32_t i = node.begin; i < node.end; ++i) {
      if (corners_[order_[i]].in_tree && Blocks(ear, order_[i])) return true;
    }
  }
  return false;
}

void EarCutter::BuildTree() {
  const auto count = static_cast<uint32_t>(points_.size());
  tree_.clear();
  order_.clear();
  leaf_.assign(count, 0);
  for (uint32_t i = 0; i < count; ++i) {
    if (TurnAt(i) > 0) continue;
    corners_[i].in_tree = true;
    order_.push_back(i);
  }
  if (!order_.empty()) AddTreeNode(0, static_cast<uint32_t>(order_.size()), 0);
}

uint32_t EarCutter::AddTreeNode(uint32_t begin, uint32_t end, uint32_t parent) {
  const auto number = static_cast<uint32_t>(tree_.size());
  TreeNode node;
  node.begin = begin;
  node.end = end;
  node.left = end - begin;
  node.parent = parent;
  node.least = node.most = points_[order_[begin]];
  for (uint32_t i = begin; i < end; ++i) {
    const PlanePoint p = points_[order_[i]];
    node.least = {std::min(node.least.x, p.x), std::min(node.least.y, p.y)};
    node.most = {std::max(node.most.x, p.x), std::max(node.most.y, p.y)};
    if (end - begin <= kLeaf) leaf_[order_[i]] = number;
  }
  tree_.push_back(node);
  if (end - begin <= kLeaf) return number;
  const bool by_x = node.most.x - node.least.x >= node.most.y - node.least.y;
  const uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](uint32_t a, uint32_t b) {
                     const PlanePoint p = points_[a], q = points_[b];
                     return by_x ? p.x < q.x : p.y < q.y;
                   });
  const uint32_t first = AddTreeNode(begin, middle, number);
  const uint32_t second = AddTreeNode(middle, end, number);
  tree_[number].children[0] = first;
  tree_[number].children[1] = second;
  return number;
}

void EarCutter::RemoveFromTree(uint32_t corner) {
  corners_[corner].in_tree = false;
  for (uint32_t node = leaf_[corner];; node = tree_[node].parent) {
    --tree_[node].left;
    if (node == 0) return;
  }
}

}  // namespace mtdb::internal
