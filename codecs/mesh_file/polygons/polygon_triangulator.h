// SPDX-License-Identifier: Apache-2.0
// PolygonTriangulator: a polygon's corners into triangles that cover it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb::internal {

class EarCutter;

// The polygon is seen along the axis that is nearest to its normal (Newell's), and turns are exact
// there. It need not be planar.
//
// A polygon whose outline does not cross itself is cut into triangles that lie inside of it, do not
// overlap, and have an area where that is possible, also with corners on a line, corners at the
// same place, and holes that edges in both directions join to the outline. A quadrilateral gets the
// shorter one of the diagonals that lie inside, of equals that of its first corner; a polygon all
// of which its first corner sees becomes a fan; others lose their best ears first.
class PolygonTriangulator {
 public:
  using Triangle = std::array<uint32_t, 3>;  // numbers of corners, in the polygon's order
  static constexpr size_t kMostCorners = size_t{1} << 18;

  PolygonTriangulator();
  ~PolygonTriangulator();

  // The triangles of 3 to kMostCorners corners: two fewer than corners, with the polygon's outline
  // as their border. `is_fan`: the outline crosses itself, or the like, so that no triangles inside
  // of it were found, and these are those around the first corner. Valid until the next call.
  // Memory: some 150 bytes a corner. Time: that of a sort and n searches in a k-d tree; limited in
  // any case.
  std::span<const Triangle> Triangulate(std::span<const Vec3d> corners, bool* is_fan);

 private:
  bool TriangulateAlong(std::span<const Vec3d> corners, int axis, bool turned);
  bool SplitQuad(std::span<const Vec3d> corners);
  bool SplitFan();
  void Fan(size_t corners);

  std::vector<Triangle> triangles_;
  std::vector<Vec3d> scaled_;
  std::unique_ptr<EarCutter> cutter_;
  std::vector<struct PlanePoint> points_;  // the corners, running counter-clockwise
};

}  // namespace mtdb::internal
