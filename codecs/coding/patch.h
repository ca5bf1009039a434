// SPDX-License-Identifier: Apache-2.0
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

#include "store/base/float4.h"
#include "store/base/geometry.h"
#include "store/base/ids.h"
#include "store/base/texture.h"

namespace mtdb {

// Rings never have more vertices than this, whatever the builder's limit.
inline constexpr uint32_t kMaxRing = 32;
inline constexpr size_t kHoleEntries = kMaxRing + 4;

// Slots are visited in ascending order. A node is inserted when the last-created triangle of its
// hole is visited (its anchor), so that every slot is visited exactly once, alive, and the whole
// hole lies at or below the anchor.
//
// A generation is the slots that exist when its first one is visited. Its nodes' holes and rings
// are older than itself, so the nodes do not depend on each other but for the adjacency: their
// triangles are connected one by one (Connect), and get their shape together (EndGeneration).
//
// Half-edge 4 * slot + i leaves corner i of the slot's triangle for corner i + 1. What lies across
// an edge of a triangle that is alive, is alive: a node's star takes the place of its hole at once.
class Patch {
 public:
  // Contexts, of 3 bits each, are specified in codecs/FORMAT.md.
  struct Triangle {
    std::array<uint32_t, 3> corners;
    std::array<uint32_t, 3> opposite;  // twin of each half-edge, or kNone32
    // Per half-edge: LengthClass << 3 | SharpnessClass of it with its opposite.
    std::array<uint8_t, 3> shape;
    uint8_t longest;  // the greatest LengthClass
    // Per half-edge, how blunt the corner is that faces it: 0 for a needle, 30 for an equilateral
    // triangle, 60 for a right angle, 120 for a flat corner.
    std::array<uint8_t, 3> bluntness;
    uint8_t error_code;  // of the node that made it; kMadeElsewhere for in-triangles
  };
  static_assert(sizeof(Triangle) == 32);

  static constexpr uint8_t kMadeElsewhere = 255;

  // A hole, its ring counter-clockwise around it (edge j runs from ring[j] to ring[j+1]), and what
  // lies beyond each ring edge.
  struct Hole {
    uint32_t* slots;  // kHoleEntries each, of which the first ones are used
    uint32_t* ring;
    std::array<uint32_t, kMaxRing> outer{};
    uint32_t slot_count = 0, ring_count = 0;
    uint32_t least_code = 0;  // of its triangles

    std::span<const uint32_t> slot_span() const { return {slots, slot_count}; }
    std::span<const uint32_t> ring_span() const { return {ring, ring_count}; }
    // True when no triangle lies beyond ring edge j.
    bool open_edge(size_t j) const { return outer[j] == kNone32; }
    // How many ring edges have nothing beyond them.
    uint32_t open_edges() const {
      uint32_t open = 0;  // without a branch, which would be hard to predict
      for (uint32_t j = 0; j < ring_count; ++j) open += static_cast<uint32_t>(open_edge(j));
      return open;
    }
    // The ring edge between two vertices, in either direction; kNone32: there is none.
    uint32_t EdgeBetween(uint32_t a, uint32_t b) const;
    // Rotates the ring so that edge `split` becomes the last one.
    void Rotate(size_t split);
  };

  // Where textures part sheets: `corners`, three per triangle, or none; and half-edges that are
  // seams although the corners on both sides are equal there.
  struct Seams {
    std::span<const TextureCorner> corners;
    std::span<const uint32_t> hidden;
  };
  // Of `triangles` between `positions`. `reference_length`: from the head of the cluster. `flat`:
  // of a height field, so that shapes are those seen along z. `two_sided`: per triangle, or empty;
  // an edge between a two-sided triangle and one that is not is a crease. So is a seam.
  Patch(std::span<const std::array<uint32_t, 3>> triangles, std::span<const Vec3i> positions,
        int reference_length, size_t expected_nodes, bool flat = false,
        std::span<const uint8_t> two_sided = {}, const Seams& seams = {});

  uint32_t slots() const { return slots_; }
  const Triangle& triangle(uint32_t slot) const { return triangles_[slot]; }
  // Per slot: the node that removed it, or kNone32 while alive.
  std::span<uint32_t> removers() { return {removers_.data(), slots_}; }
  // Leaves none.
  std::vector<uint32_t> TakeRemovers() {
    removers_.resize(slots_);
    return std::move(removers_);
  }
  uint32_t remover(uint32_t slot) const { return removers_[slot]; }
  // Of local vertices: x, y, z, 0.
  const Word4* points() const { return points_.data(); }
  void AddPoint(Vec3i p) {
    points_.push_back(Word4{static_cast<uint32_t>(p.x), static_cast<uint32_t>(p.y),
                            static_cast<uint32_t>(p.z), 0});
  }

  // The hole of node `node`, anchored at `anchor` (alive), by depth-first search across edges.
  // Asks `take(possible, count, slot, shape)` for each neighbour; only those below the anchor are
  // possible, and may be taken. The hole has `count` triangles so far, and the half-edge to the
  // neighbour in that slot has that shape. Marks the hole's slots as removed by `node`, and
  // connects a triangle of the node's star to each ring edge. Returns false when the ring would
  // exceed kMaxRing, the hole runs into itself or a vertex occurs twice in the ring.
  template <typename Take>
  [[gnu::always_inline]] bool WalkHole(uint32_t anchor, uint32_t node, Hole& hole, Take&& take) {
    return WalkHole(anchor, anchor, node, hole, take);
  }
  // Likewise another hole of the same node, from the triangle `first` on.
  template <typename Take>
  [[gnu::always_inline]] bool WalkHole(uint32_t first, uint32_t anchor, uint32_t node, Hole& hole,
                                       Take&& take) {
    if (slots_ + kMaxRing > removers_.size()) [[unlikely]] {
      Grow(removers_.size() + removers_.size() / 2 + kMaxRing);
    }
    uint32_t stack[kMaxRing];  // of half-edges; never more than the ring will have
    uint32_t depth = 2;
    uint32_t holes = 1;
    uint32_t rings = 0;
    stack[0] = 4 * first + 2;
    stack[1] = 4 * first + 1;
    Triangle* const triangles = triangles_.get();
    uint32_t* const removers = removers_.data();
    uint32_t* const last_apex = last_apex_.data();
    const uint32_t apex = first_apex_ + node;
    bool disc = true;
    uint32_t unused;
    uint32_t* end_of_edge = &unused;
    uint32_t star = 4 * slots_;
    hole.slots[0] = first;
    removers[first] = node;
    uint32_t least_code = triangles[first].error_code;
    uint32_t h = 4 * first;
    for (;;) {
      const Triangle& t = triangles[h >> 2];
      const uint32_t o = t.opposite[h & 3];
      const uint32_t slot = o >> 2;
      if (take(slot < anchor, holes, slot, t.shape[h & 3])) {
        if (holes + 2 >= kMaxRing || removers[slot] != kNone32) return false;
        hole.slots[holes++] = slot;
        least_code = std::min<uint32_t>(least_code, triangles[slot].error_code);
        removers[slot] = node;
        h = Next(o);
        stack[depth++] = Next(h);
        continue;
      }
      const uint32_t corner = t.corners[h & 3];
      hole.ring[rings] = corner;
      hole.outer[rings++] = o;
      // Beyond the edge may lie nothing, or an older triangle, but not this very star.
      disc &= static_cast<int32_t>(o - 4 * slots_) < 0;
      disc &= last_apex[corner] != apex;
      last_apex[corner] = apex;
      *end_of_edge = corner;
      AddStarTriangle(triangles, star, apex, corner, o);
      end_of_edge = &triangles[star >> 2].corners[2];
      star += 4;
      if (depth == 0) break;
      h = stack[--depth];
    }
    // The star is closed.
    *end_of_edge = hole.ring[0];
    triangles[star / 4 - 1].opposite[2] = 4 * slots_;
    triangles[slots_].opposite[0] = star - 2;
    slots_ += rings;
    hole.slot_count = holes;
    hole.ring_count = rings;
    hole.least_code = least_code;
    return disc;
  }
  // Makes the star of the hole that was just walked, of a boundary node, end where its ring, which
  // was rotated, ends: it has one triangle less.
  void OpenStar(const Hole& hole);

  // Of clusters with nodes of several fans: keeps track of the edges where triangles have no
  // opposite.
  void IndexCreases();
  // The node's star, of the hole that was just walked, is there; `boundary`: it is open.
  void NoteCreases(const Hole& hole, bool boundary);
  // The half-edges without an opposite between two vertices, of triangles that are there, in
  // ascending order: those of the other holes of a node, when the first one has been walked.
  std::span<const uint32_t> FindCrease(uint32_t a, uint32_t b);
  // Whether FindCrease took longer than edges can make it take that nobody chose for that.
  bool crease_search_is_hostile() const { return crease_steps_ >> 10 > slots_; }
  // Vertices of the ring of a node's hole may be in the rings of its other holes, too.
  void AllowInNextRing(const Hole& hole) {
    for (const uint32_t v : hole.ring_span()) last_apex_[v] = kNone32;
  }

  // Gives the triangles that the nodes of the visited generation made their shapes and error codes.
  // Their corners must have points; `codes`: of all nodes so far.
  void EndGeneration(std::span<const uint8_t> codes);
  // Nobody asks for shapes: generations end without them.
  void LeaveOutShapes() { shapes_ = false; }

  static uint32_t Next(uint32_t h) { return (h & 3) == 2 ? h - 2 : h + 1; }

 private:
  // The triangle whose half-edge 0 is `h`, but for its last corner.
  static void AddStarTriangle(Triangle* triangles, uint32_t h, uint32_t apex, uint32_t corner,
                              uint32_t outer) {
    Triangle& t = triangles[h >> 2];
    t.corners[0] = apex;
    t.corners[1] = corner;
    t.opposite = {h - 2, outer, h + 4};
    if (outer != kNone32) triangles[outer >> 2].opposite[outer & 3] = h + 1;
  }
  void NoteCrease(uint32_t half_edge);
  void PairEdges();
  void PartSheets(std::span<const uint8_t> two_sided, const Seams& seams);
  void Grow(size_t slots);
  void Measure(uint32_t begin, uint32_t end);

  uint32_t slots_ = 0;
  std::unique_ptr<Triangle[]> triangles_;  // as many as removers_
  std::vector<uint32_t> removers_;         // behind the slots: kNone32
  std::vector<Word4> points_;
  std::vector<uint32_t> last_apex_;  // per vertex: the last one whose ring it was in
  uint32_t shaped_ = 0;              // slots below it have shapes and error codes
  bool shapes_ = true;               // false: error codes alone
  uint32_t shortest_;                // the exponent of length class 0, as a float has it
  uint32_t first_apex_;              // the vertex of node 0
  float height_ = 1;                 // what differences of z count: 0 when flat
  // Half-edges that had no opposite, in lists of those whose ends have one hash; some are gone.
  struct Crease {
    uint64_t ends;
    uint32_t half_edge, next;
  };
  std::vector<Crease> creases_;
  std::vector<uint32_t> crease_lists_;
  uint64_t crease_steps_ = 0;
  std::vector<uint32_t> crease_;  // the one that was found
};

}  // namespace mtdb
