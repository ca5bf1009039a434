// Patch: the triangles of a cluster while its updates are replayed, with adjacency and the rough
// shape that contexts are made of. The encoder and the decoder walk the same patch, so that a code
// bit means the same to both.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/ids.h"

namespace mtdb {

// The binary exponent of x: floor(log2(x)) for x >= 1, and 0 below.
int Exponent(double x);

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
    // Per half-edge: 8 times the cotangent of the angle that faces it, rounded down and clamped to
    // +-kMaxCotangent; the exponent of its squared length.
    std::array<int8_t, 3> cotangent;
    std::array<uint8_t, 3> length;
  };
  static constexpr int kMaxCotangent = 100;

  // `points` are the positions of local vertices; it grows by one before each InsertStar and must
  // outlive the patch.
  Patch(std::span<const std::array<uint32_t, 3>> in_triangles, const std::vector<Vec3d>& points,
        size_t expected_slots);

  uint32_t slots() const { return static_cast<uint32_t>(triangles_.size()); }
  const Triangle& triangle(uint32_t slot) const { return triangles_[slot]; }
  uint32_t remover(uint32_t slot) const { return triangles_[slot].remover; }

  // The hole of node `node`, anchored at `anchor` (alive), by depth-first search across edges.
  // Asks `take(h, o)` for each neighbour that could belong to it: alive and at or below the anchor;
  // h is the half-edge of the hole, o its twin. Fills hole() and ring(), marks the hole's slots as
  // removed by `node`. Returns false when the ring would exceed `max_ring`.
  template <typename Take>
  bool WalkHole(uint32_t anchor, uint32_t node, uint32_t max_ring, Take&& take) {
    hole_.clear();
    ring_.clear();
    outer_.clear();
    stack_.clear();
    hole_.push_back(anchor);
    triangles_[anchor].remover = node;
    stack_.insert(stack_.end(), {4 * anchor + 2, 4 * anchor + 1, 4 * anchor});
    while (!stack_.empty()) {
      const uint32_t h = stack_.back();
      stack_.pop_back();
      const Triangle& t = triangles_[h >> 2];
      const uint32_t o = t.opposite[h & 3];
      if (o != kNone32) {
        const uint32_t slot = o >> 2;
        if (slot <= anchor && triangles_[slot].remover == kNone32 && take(h, o)) {
          if (hole_.size() + 2 >= max_ring) return false;
          hole_.push_back(slot);
          triangles_[slot].remover = node;
          stack_.push_back(Next(Next(o)));
          stack_.push_back(Next(o));
          continue;
        }
      }
      ring_.push_back(t.corners[h & 3]);
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

  static uint32_t Next(uint32_t h) { return (h & 3) == 2 ? h - 2 : h + 1; }

 private:
  void Link(uint32_t a, uint32_t b) {
    triangles_[a >> 2].opposite[a & 3] = b;
    if (b != kNone32) triangles_[b >> 2].opposite[b & 3] = a;
  }
  // Fills in cotangents and lengths from the squared lengths of the half-edges.
  static void SetShape(Triangle& t, const std::array<double, 3>& squared);
  void PairEdges();

  const std::vector<Vec3d>& points_;
  std::vector<Triangle> triangles_;
  std::vector<uint32_t> hole_, ring_, outer_, stack_;
  std::vector<double> spokes_;  // scratch of InsertStar
};

}  // namespace mtdb
