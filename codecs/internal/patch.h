// Patch: the triangles of a cluster while its updates are replayed, with adjacency. The encoder and
// the decoder walk the same patch, so that a code bit means the same to both.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/ids.h"

namespace mtdb {

// Slots are visited in ascending order. A node is inserted when the last-created triangle of its
// hole is visited (its anchor), so that every slot is visited exactly once, alive, and the whole
// hole lies at or below the anchor.
class Patch {
 public:
  explicit Patch(std::span<const std::array<uint32_t, 3>> in_triangles, size_t expected_slots);

  uint32_t slots() const { return static_cast<uint32_t>(removers_.size()); }
  uint32_t remover(uint32_t slot) const { return removers_[slot]; }
  std::vector<uint32_t>& removers() { return removers_; }

  // The hole of node `node`, anchored at `anchor` (alive), by depth-first search across edges.
  // Asks `take(slot)` for each neighbour that could belong to it: alive and at or below the anchor.
  // Fills hole() and ring(), marks the hole's slots as removed by `node`. Returns false when the
  // ring would exceed `max_ring`.
  template <typename Take>
  bool WalkHole(uint32_t anchor, uint32_t node, uint32_t max_ring, Take&& take) {
    hole_.clear();
    ring_.clear();
    outer_.clear();
    stack_.clear();
    hole_.push_back(anchor);
    removers_[anchor] = node;
    stack_.insert(stack_.end(), {3 * anchor + 2, 3 * anchor + 1, 3 * anchor});
    while (!stack_.empty()) {
      const uint32_t h = stack_.back();
      stack_.pop_back();
      const uint32_t o = opposite_[h];
      if (o != kNone32) {
        const uint32_t slot = o / 3;
        if (slot <= anchor && removers_[slot] == kNone32 && take(slot)) {
          if (hole_.size() + 2 >= max_ring) return false;
          hole_.push_back(slot);
          removers_[slot] = node;
          stack_.push_back(Next(Next(o)));
          stack_.push_back(Next(o));
          continue;
        }
      }
      ring_.push_back(origin_[h]);
      outer_.push_back(o);
    }
    return true;
  }

  const std::vector<uint32_t>& hole() const { return hole_; }
  // Counter-clockwise around the hole; edge j runs from ring[j] to ring[j+1].
  const std::vector<uint32_t>& ring() const { return ring_; }
  // True when no triangle lies beyond ring edge j.
  bool open_edge(size_t j) const { return outer_[j] == kNone32; }
  // Rotates the ring so that edge `split` becomes the last one.
  void RotateRing(size_t split);
  // Adds the star of `vertex`: one triangle per ring edge, but for the last edge when `boundary`.
  void InsertStar(uint32_t vertex, bool boundary);

 private:
  static uint32_t Next(uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
  void Link(uint32_t a, uint32_t b) {
    opposite_[a] = b;
    if (b != kNone32) opposite_[b] = a;
  }

  std::vector<uint32_t> origin_;    // per half-edge 3 * slot + i: the vertex that it leaves
  std::vector<uint32_t> opposite_;  // per half-edge: its twin or kNone32
  std::vector<uint32_t> removers_;  // per slot: node or kNone32 while alive
  std::vector<uint32_t> hole_, ring_, outer_, stack_;
};

}  // namespace mtdb
