// SPDX-License-Identifier: Apache-2.0
// Lattice: which points of a raster's lattice a cluster's next vertex may be. Every cut of a
// terrain is the Delaunay triangulation of its vertices, so a hole consists of the triangles in
// whose circles the vertex lies: each triangle that the hole takes or does not take leaves fewer
// points, and the points that are left tell what comes next. Specified in codecs/FORMAT.md,
// "Lattice".
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "codecs/coding/cluster_model.h"
#include "codecs/coding/patch.h"
#include "store/base/geometry.h"
#include "store/base/in_circle.h"

namespace mtdb::internal {

class Lattice {
 public:
  // Of the patch's in-triangles between `positions`. `nodes`: of the cluster. `with_border`: points
  // on edges without an opposite may be vertices. Returns nothing when the lattice is too large for
  // the nodes, so that asking all its points would take too long.
  static std::optional<Lattice> Make(const Patch& patch, std::span<const Vec3i> positions,
                                     size_t nodes, bool with_border);

  // A new vertex of the patch.
  void AddVertex(LatticePoint p);
  bool IsFree(LatticePoint p) const {
    return p.x >= 0 && p.y >= 0 && p.x < width_ && p.y < height_ && Word(p) >> (p.x & 63) & 1;
  }
  LatticePoint ToLattice(Vec3i p) const { return {p.x - origin_.x, p.y - origin_.y}; }
  LatticePoint ToGrid(LatticePoint p) const { return {p.x + origin_.x, p.y + origin_.y}; }

  // The candidates of a node are at first the free points in the circle of its anchor, but for
  // those in the circles of neighbours that were not visited yet.
  void SetAnchor(const Patch& patch, uint32_t anchor);
  // How many candidates lie in the circle of the triangle in `slot`.
  uint32_t CountInside(const Patch& patch, uint32_t slot);
  // Keeps the candidates that lie (or do not lie) in the circle that was asked last.
  void Keep(bool inside);
  // Drops the candidates in the circles of triangles around the hole that come after its anchor.
  void Exclude(const Patch& patch, const Patch::Hole& hole, uint32_t anchor);
  // The open ring edge that p lies on; none: kNone32.
  uint32_t SplitEdge(const Patch::Hole& hole, LatticePoint p) const;

  // In the order of rows, then columns.
  std::span<const LatticePoint> candidates() const { return candidates_; }
  // More points were asked than the cluster's size allows: no use to go on.
  bool exhausted() const { return budget_ < 0; }

 private:
  // The circle through the corners of a triangle; empty when these do not run counter-clockwise.
  struct Circle {
    LatticePoint a, b, c;
    int64_t area, u, v;  // p inside: area |p - a|^2 < u (p - a).x + v (p - a).y
  };
  Circle CircleOf(const Patch& patch, uint32_t slot) const;
  static bool IsInside(const Circle& circle, LatticePoint p);

  uint64_t& Word(LatticePoint p) { return free_[static_cast<size_t>(p.y * words_ + (p.x >> 6))]; }
  uint64_t Word(LatticePoint p) const {
    return free_[static_cast<size_t>(p.y * words_ + (p.x >> 6))];
  }
  void SetFree(LatticePoint p) { Word(p) |= uint64_t{1} << (p.x & 63); }
  void Clear(LatticePoint p) { Word(p) &= ~(uint64_t{1} << (p.x & 63)); }
  void FreeTriangle(LatticePoint a, LatticePoint b, LatticePoint c);
  void ClearEdge(LatticePoint a, LatticePoint b);

  LatticePoint origin_;
  int64_t width_ = 0, height_ = 0, words_ = 0;
  std::vector<uint64_t> free_;          // rows of bits
  std::vector<LatticePoint> vertices_;  // of the patch
  std::vector<LatticePoint> candidates_;
  std::vector<uint8_t> inside_;  // per candidate, of the circle that was asked last
  int64_t budget_ = 0;           // points that may still be asked
};

// Is `slot` the anchor of a node? Sets the candidates of its vertex.
template <typename Coder>
bool CodeLatticeAnchor(Coder&& coder, LatticeModel& model, const Patch& patch, Lattice& lattice,
                       uint32_t slot, bool value) {
  lattice.SetAnchor(patch, slot);
  uint32_t later = 0;
  for (const uint32_t o : patch.triangle(slot).opposite) later += o != kNone32 && o >> 2 > slot;
  return model.CodeAnchor(coder, later, static_cast<uint32_t>(lattice.candidates().size()), value);
}

}  // namespace mtdb::internal
