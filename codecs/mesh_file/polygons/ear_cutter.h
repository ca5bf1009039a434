// SPDX-License-Identifier: Apache-2.0
// EarCutter: triangles of a polygon in the plane, ear after ear.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <queue>
#include <span>
#include <vector>

#include "codecs/mesh_file/polygons/exact_turn.h"

namespace mtdb::internal {

// An ear is a corner whose triangle with its neighbours lies inside of the polygon. It is cut off,
// until three corners are left. Whether a corner is an ear changes by that for its two neighbours
// alone, so that some 3 n triangles are looked into. A corner that lies in a triangle can only be
// one that does not turn left; these are in a k-d tree, which counts those that are left.
class EarCutter {
 public:
  // Puts the triangles of the polygon, which runs counter-clockwise, into `triangles`. False when
  // no ear is left before it is done, or after more work than a polygon without crossings takes.
  // `folds_first`: edges that run to a corner and back are outside of the polygon, and are cut off
  // before the ears; otherwise they are inside, and their corner is one of the triangles around it.
  bool Cut(std::span<const PlanePoint> points, bool folds_first,
           std::vector<std::array<uint32_t, 3>>* triangles);

 private:
  struct Corner {
    uint32_t before = 0, after = 0;
    uint32_t version = 0;  // of its neighbours
    bool is_cut = false;
    bool in_tree = false;  // and counted there
  };
  struct Candidate {
    double quality = 0;  // of an ear: its shape; of a triangle without area: see .cc
    uint32_t corner = 0;
    uint32_t version = 0;
    friend bool operator<(const Candidate& a, const Candidate& b) {
      return a.quality != b.quality ? a.quality < b.quality : a.corner > b.corner;
    }
  };
  struct TreeNode {
    PlanePoint least, most;
    uint32_t begin = 0, end = 0;  // of order_
    uint32_t left = 0;            // corners that are still there and do not turn left
    uint32_t parent = 0;
    uint32_t children[2] = {0, 0};  // 0: a leaf
  };
  struct Ear {
    uint32_t a, b, c;  // corners; b is to be cut off
    PlanePoint pa, pb, pc;
  };

  void BuildTree();
  uint32_t AddTreeNode(uint32_t begin, uint32_t end, uint32_t parent);
  void RemoveFromTree(uint32_t corner);
  int TurnAt(uint32_t corner) const;
  // Queues the corner when it may be cut off.
  void Consider(uint32_t corner);
  double QualityOf(const Ear& ear) const;
  bool IsEar(const Ear& ear);
  bool Blocks(const Ear& ear, uint32_t corner) const;
  bool AnyBlocks(const Ear& ear);
  static bool MayHold(const Ear& ear, const TreeNode& node);
  void CutOff(uint32_t corner, std::vector<std::array<uint32_t, 3>>* triangles);

  std::span<const PlanePoint> points_;
  std::vector<Corner> corners_;
  std::vector<TreeNode> tree_;
  std::vector<uint32_t> order_, leaf_;
  std::vector<uint32_t> stack_;
  std::priority_queue<Candidate> queue_;
  uint64_t work_ = 0, most_work_ = 0;
  double folded_ = 0;  // the quality of two corners at one place, or of an edge that runs back
};

}  // namespace mtdb::internal
