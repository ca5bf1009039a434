// SPDX-License-Identifier: Apache-2.0
// Lattice: which points of a raster's lattice a cluster's next vertex may be. Every cut of a
// terrain is the Delaunay triangulation of its vertices, so a hole consists of the triangles in
// whose circles the vertex lies: each triangle that the hole takes or does not take leaves fewer
// points, and the points that are left tell what comes next. Specified in codecs/FORMAT.md,
// "Lattice".
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "codecs/cluster/internal/circle_masks.h"
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

  // A new vertex of the patch, which has its star.
  void AddVertex(const Patch& patch, LatticePoint p);
  LatticePoint ToLattice(Vec3i p) const { return {p.x - origin_.x, p.y - origin_.y}; }
  LatticePoint ToGrid(LatticePoint p) const { return {p.x + origin_.x, p.y + origin_.y}; }

  // The candidates of a node are at first the free points in the circle of its anchor, but for
  // those in the circles of neighbours that were not visited yet.
  void SetAnchor(const Patch& patch, uint32_t anchor);
  // How many candidates there are.
  uint32_t count() const { return count_; }
  // How many of them lie in the circle of the triangle in `slot`.
  uint32_t CountInside(const Patch& patch, uint32_t slot) {
    const Disc disc = discs_[slot];
    if (windows_.size() == 1 && !disc.large()) [[likely]]
      return CountInsideWindow(disc);
    return CountInsideLarge(patch, slot);
  }
  // Keeps the candidates that lie (or do not lie) in the circle that was asked last.
  void Keep(bool inside);
  // Drops the candidates in the circles of triangles around the hole that come after its anchor.
  void Exclude(const Patch& patch, const Patch::Hole& hole, uint32_t anchor);
  // Candidates by their order, by rows, then columns; and the number of one, count() of another
  // point.
  LatticePoint candidate(uint32_t number);
  uint32_t NumberOf(LatticePoint candidate);
  // The open ring edge that p lies on; none: kNone32.
  uint32_t SplitEdge(const Patch::Hole& hole, LatticePoint p) const;

  // More points were asked than the cluster's size allows: no use to go on.
  bool exhausted() const { return budget_ < 0; }

 private:
  Circle CircleOf(const Patch& patch, uint32_t slot) const;
  void AddDiscs(const Patch& patch);
  bool Gather(Window& window) const;
  void Drop(const Patch& patch, uint32_t slot);
  uint32_t CountInsideWindow(Disc disc);
  void GatherLarge(const Circle& circle);
  uint32_t CountInsideLarge(const Patch& patch, uint32_t slot);
  void ListCandidates();

  // Points are bits of free_, with a window's size around the box.
  size_t WordOf(LatticePoint p) const {
    return static_cast<size_t>((p.y + Window::kSide) * words_ + ((p.x + Window::kSide) >> 6));
  }
  static int BitOf(LatticePoint p) { return (p.x + Window::kSide) & 63; }
  void SetFree(LatticePoint p) { free_[WordOf(p)] |= uint64_t{1} << BitOf(p); }
  void Clear(LatticePoint p) { free_[WordOf(p)] &= ~(uint64_t{1} << BitOf(p)); }
  void FreeTriangle(LatticePoint a, LatticePoint b, LatticePoint c);
  void ClearEdge(LatticePoint a, LatticePoint b);

  LatticePoint origin_;
  int64_t width_ = 0, height_ = 0, words_ = 0;
  std::vector<uint64_t> free_;
  std::vector<LatticePoint> vertices_;  // of the patch
  CircleMasks masks_;
  std::vector<Disc> discs_;  // per slot

  // The candidates: one window, but for anchors with large circles.
  std::vector<Window> windows_;
  std::vector<Window> inside_{1};  // in the circle that was asked last
  uint32_t count_ = 0, inside_count_ = 0;
  std::vector<LatticePoint> listed_;
  int64_t budget_ = 0;  // points that may still be asked
};

// Is `slot` the anchor of a node? Sets the candidates of its vertex.
template <typename Coder>
bool CodeLatticeAnchor(Coder&& coder, LatticeModel& model, const Patch& patch, Lattice& lattice,
                       uint32_t slot, bool value) {
  lattice.SetAnchor(patch, slot);
  uint32_t later = 0;
  for (const uint32_t o : patch.triangle(slot).opposite) later += o != kNone32 && o >> 2 > slot;
  return model.CodeAnchor(coder, later, lattice.count(), value);
}

}  // namespace mtdb::internal
