// Patch: the triangles of a cluster while its updates are replayed, with adjacency and the rough
// shape that contexts are made of. The encoder and the decoder walk the same patch, so that a code
// bit means the same to both.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "codecs/cluster_codec.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb {

// Slots are visited in ascending order. A node is inserted when the last-created triangle of its
// hole is visited (its anchor), so that every slot is visited exactly once, alive, and the whole
// hole lies at or below the anchor.
//
// Half-edge 4 * slot + i leaves corner i of the slot's triangle for corner i + 1.
class Patch {
 public:
  struct Triangle {
    std::array<uint32_t, 3> corners;
    std::array<uint32_t, 3> opposite;  // twin of each half-edge, or kNone32
    uint32_t remover;                  // node, or kNone32 while alive
    // Per half-edge, how sharp the corner is that faces it: 64 for a needle, 32 for an equilateral
    // triangle, 0 for a right angle, -64 for a flat corner.
    std::array<int8_t, 3> sharpness;
    std::array<uint8_t, 3> length;  // per half-edge: exponent of its squared length
    uint8_t longest;                // the greatest of `length`
    uint8_t error_code;             // of the node that made it; unused for in-triangles
  };

  // `positions` of local vertices grow by one before each InsertStar, and outlive the patch.
  Patch(std::span<const std::array<uint32_t, 3>> in_triangles, const std::vector<Vec3i>& positions,
        size_t expected_slots);

  uint32_t slots() const { return static_cast<uint32_t>(triangles_.size()); }
  const Triangle& triangle(uint32_t slot) const { return triangles_[slot]; }
  uint32_t remover(uint32_t slot) const { return triangles_[slot].remover; }
  Vec3d point(uint32_t vertex) const { return ToDouble(positions_[vertex]); }

  // The hole of node `node`, anchored at `anchor` (alive), by depth-first search across edges.
  // Asks `take(count, h, o)` for each neighbour that could belong to it: alive and at or below the anchor;
  // the hole has `count` triangles so far, h is its half-edge, o the twin. Fills hole() and ring(), marks the hole's slots as
  // removed by `node`. Returns false when the ring would exceed kMaxRing.
  template <typename Take>
  [[gnu::always_inline]] bool WalkHole(uint32_t anchor, uint32_t node, Take&& take) {
    uint32_t stack[kMaxRing];  // of half-edges; never more than the ring will have
    uint32_t depth = 3;
    uint32_t holes = 1;
    uint32_t rings = 0;
    stack[0] = 4 * anchor + 2;
    stack[1] = 4 * anchor + 1;
    stack[2] = 4 * anchor;
    Triangle* const triangles = triangles_.data();
    hole_[0] = anchor;
    triangles[anchor].remover = node;
    while (depth > 0) {
      const uint32_t h = stack[--depth];
      const Triangle& t = triangles[h >> 2];
      const uint32_t o = t.opposite[h & 3];
      const uint32_t slot = o >> 2;
      if (slot <= anchor && triangles[slot].remover == kNone32 && take(holes, h, o)) {
        if (holes + 2 >= kMaxRing) return false;
        hole_[holes++] = slot;
        triangles[slot].remover = node;
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
  // Adds the star of `vertex`, made by a node with that error code: one triangle per ring edge, but
  // for the last edge when `boundary`.
  void InsertStar(uint32_t vertex, bool boundary, uint8_t error_code);

  static uint32_t Next(uint32_t h) { return (h & 3) == 2 ? h - 2 : h + 1; }

 private:
  void Link(uint32_t a, uint32_t b) {
    triangles_[a >> 2].opposite[a & 3] = b;
    if (b != kNone32) triangles_[b >> 2].opposite[b & 3] = a;
  }
  void PairEdges();

  const std::vector<Vec3i>& positions_;
  std::vector<Triangle> triangles_;
  std::array<uint32_t, kMaxRing> hole_{}, ring_{}, outer_{};
  uint32_t hole_count_ = 0;
  uint32_t ring_count_ = 0;
};

}  // namespace mtdb
