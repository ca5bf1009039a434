// Patch: the triangles of a cluster while its updates are replayed, with adjacency and the rough
// shape that contexts are made of. The encoder and the decoder walk the same patch, so that a code
// bit means the same to both.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "codecs/cluster_codec.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb {

// The points of a ring, relative to its first one, axis by axis and padded with zeros: what lies
// behind the last vertex is the first one again.
struct RingPoints {
  static constexpr size_t kSize = kMaxRing + 8;
  uint32_t count;
  Vec3i base;
  float at[3][kSize];

  // Differences wrap around, so that they always fit.
  static float Offset(int32_t to, int32_t from) {
    return static_cast<float>(
        static_cast<int32_t>(static_cast<uint32_t>(to) - static_cast<uint32_t>(from)));
  }
  void Gather(std::span<const uint32_t> ring, const std::vector<Vec3i>& positions) {
    count = static_cast<uint32_t>(ring.size());
    base = positions[ring[0]];
    for (uint32_t j = 0; j < count; ++j) {
      const Vec3i& p = positions[ring[j]];
      for (int i = 0; i < 3; ++i) at[i][j] = Offset(p[i], base[i]);
    }
    for (auto& axis : at) std::fill_n(axis + count, 8, 0.0f);
  }
};

// Slots are visited in ascending order. A node is inserted when the last-created triangle of its
// hole is visited (its anchor), so that every slot is visited exactly once, alive, and the whole
// hole lies at or below the anchor.
//
// Half-edge 4 * slot + i leaves corner i of the slot's triangle for corner i + 1. What lies across
// an edge of a triangle that is alive, is alive: a node's star takes the place of its hole at once.
class Patch {
 public:
  struct Triangle {
    std::array<uint32_t, 3> corners;
    std::array<uint32_t, 3> opposite;  // twin of each half-edge, or kNone32
    // Per half-edge, how sharp the corner is that faces it: 60 for a needle, 30 for an equilateral
    // triangle, 0 for a right angle, -60 for a flat corner.
    std::array<int8_t, 3> sharpness;
    uint8_t error_code;             // of the node that made it; unused for in-triangles
    std::array<uint8_t, 3> both;    // kBothZero + the sum of the two corners that face the edge
    uint8_t longest;                // the greatest of `length`
    std::array<uint8_t, 3> length;  // per half-edge: exponent of its squared length
    uint8_t unused;
  };
  static_assert(sizeof(Triangle) == 36);
  static constexpr int kBothZero = 128;

  Patch(std::span<const std::array<uint32_t, 3>> in_triangles, const std::vector<Vec3i>& positions,
        size_t expected_slots);

  uint32_t slots() const { return static_cast<uint32_t>(removers_.size()); }
  const Triangle& triangle(uint32_t slot) const { return triangles_[slot]; }
  // Per slot: the node that removed it, or kNone32 while alive.
  std::vector<uint32_t>& removers() { return removers_; }
  uint32_t remover(uint32_t slot) const { return removers_[slot]; }

  // The hole of node `node`, anchored at `anchor` (alive), by depth-first search across edges.
  // Asks `take(count, t, i)` for each neighbour that could belong to it, below the anchor: the hole
  // has `count` triangles so far, and the neighbour lies across half-edge i of its triangle t.
  // Fills hole() and ring(), marks the hole's slots as removed by `node`. Returns false when the
  // ring would exceed kMaxRing or the hole runs into itself.
  template <typename Take>
  [[gnu::always_inline]] bool WalkHole(uint32_t anchor, uint32_t node, Take&& take) {
    uint32_t stack[kMaxRing];  // of half-edges; never more than the ring will have
    uint32_t depth = 3;
    uint32_t holes = 1;
    uint32_t rings = 0;
    stack[0] = 4 * anchor + 2;
    stack[1] = 4 * anchor + 1;
    stack[2] = 4 * anchor;
    const Triangle* const triangles = triangles_.get();
    uint32_t* const removers = removers_.data();
    hole_[0] = anchor;
    removers[anchor] = node;
    while (depth > 0) {
      const uint32_t h = stack[--depth];
      const Triangle& t = triangles[h >> 2];
      const uint32_t o = t.opposite[h & 3];
      const uint32_t slot = o >> 2;
      if (slot < anchor && take(holes, t, h & 3)) {
        if (holes + 2 >= kMaxRing || removers[slot] != kNone32) return false;
        hole_[holes++] = slot;
        removers[slot] = node;
        stack[depth++] = Next(Next(o));
        stack[depth++] = Next(o);
        continue;
      }
      ring_[rings] = t.corners[h & 3];
      outer_[rings++] = o;
    }
    hole_count_ = holes;
    ring_count_ = rings;
    return true;
  }

  std::span<const uint32_t> hole() const { return {hole_.data(), hole_count_}; }
  // All of kMaxRing entries, of which ring() and hole() are the first.
  const uint32_t* ring_data() const { return ring_.data(); }
  const uint32_t* hole_data() const { return hole_.data(); }
  // Counter-clockwise around the hole; edge j runs from ring[j] to ring[j+1].
  std::span<const uint32_t> ring() const { return {ring_.data(), ring_count_}; }
  // True when no triangle lies beyond ring edge j.
  bool open_edge(size_t j) const { return outer_[j] == kNone32; }
  // Rotates the ring so that edge `split` becomes the last one.
  void RotateRing(size_t split);
  // How many ring edges have nothing beyond them.
  uint32_t open_edges() const {
    uint32_t count = 0;
    for (uint32_t j = 0; j < ring_count_; ++j) count += outer_[j] == kNone32;
    return count;
  }
  // Adds the star of `vertex` at `apex`, made by a node with that error code: one triangle per ring
  // edge, but for the last edge when `boundary`. `points` are the ring's.
  void InsertStar(uint32_t vertex, Vec3i apex, const RingPoints& points, bool boundary,
                  uint8_t error_code);

  static uint32_t Next(uint32_t h) { return (h & 3) == 2 ? h - 2 : h + 1; }

 private:
  void PairEdges();
  void Grow(uint32_t count);

  std::unique_ptr<Triangle[]> triangles_;  // slots() of capacity_
  size_t capacity_ = 0;
  std::vector<uint32_t> removers_;
  std::array<uint32_t, kMaxRing> hole_{}, ring_{}, outer_{};
  uint32_t hole_count_ = 0;
  uint32_t ring_count_ = 0;
};

}  // namespace mtdb
