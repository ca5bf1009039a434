// SPDX-License-Identifier: Apache-2.0
// TriangleTree: how far a point is from many triangles, bounded from both sides.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "query/compare/box_tree.h"
#include "store/base/geometry.h"

namespace mtdb::internal {

// Immutable; safe for many threads.
class TriangleTree {
 public:
  // `outward`: by how much bounds are moved outwards for the rounding of distances.
  TriangleTree(std::vector<Triangle3d> triangles, double outward);

  bool empty() const { return triangles_.empty(); }
  const Triangle3d& triangle(uint32_t place) const { return triangles_[place]; }

  struct Near {
    double low, high;       // of the distance from all triangles; infinite without any
    uint32_t triangle = 0;  // that is so near, by place
  };
  // `hint`: a triangle that may be near.
  Near Nearest(Vec3d p, uint32_t hint) const;
  // At least the distance of p from one triangle; infinite where there are none.
  double High(Vec3d p, uint32_t triangle) const;

 private:
  struct Search;
  TriangleTree(std::vector<Triangle3d> triangles, std::vector<Box3d> boxes, double outward);

  BoxTree boxes_;
  std::vector<Triangle3d> triangles_;  // by place
  double outward_;
};

}  // namespace mtdb::internal
