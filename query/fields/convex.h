// SPDX-License-Identifier: Apache-2.0
// Convex: a convex polyhedron as half-spaces and edges; distances to triangles.
#pragma once

#include <cmath>
#include <vector>

#include "query/region.h"

namespace mtdb::internal {

// Bounded or not, flat or not. Empty ones are nowhere near anything.
class Convex final : public Region {
 public:
  explicit Convex(const std::vector<HalfSpace>& half_spaces);

  bool Within(const Triangle3d& t, double distance) const override;
  bool Covers(const Triangle3d& t, double distance) const override;
  bool BoxWithin(const Box3d& box, double distance) const override;
  bool BoxCovers(const Box3d& box, double distance) const override;
  double Depth(const Box3d& box) const override;
  double Shift(const Region& to, const Box3d& within) const override;

  std::vector<HalfSpace> HalfSpaces() const;

 private:
  // Of the points of a box over a plane.
  struct Heights {
    double middle, reach;
    double Lowest() const { return middle - reach; }
    double Highest() const { return middle + reach; }
    double Size() const { return std::abs(middle) + reach; }
  };
  struct Plane {
    HalfSpace half_space;  // its normal has length 1
    double scale;          // the largest coordinate of its point
    // Of p over the plane; negative inside.
    double Height(Vec3d p) const { return Dot(p - half_space.point, half_space.normal); }
    Heights HeightsIn(const Box3d& box) const;
    friend bool operator==(const Plane& a, const Plane& b) {
      return a.half_space.point == b.half_space.point && a.half_space.normal == b.half_space.normal;
    }
  };
  // The points origin + s * direction, begin <= s <= end; the ends may be infinite.
  struct Line {
    Vec3d origin, direction;  // the latter of length 1
    double begin, end;
    double scale;  // the largest coordinate that it was computed from
  };

  void FindEdges();
  void FindBounds();
  // The largest of the planes' lowest heights over the box: how far outside the box is, or
  // (negative) how deep inside a part of it may be.
  double HighestPlane(const Box3d& box) const;
  // Shortens the line to its part in the polyhedron; false when nothing is left.
  bool Clip(Line& line) const;
  bool MeetsEdge(const Triangle3d& t, double scale) const;
  // Whether a corner has its nearest point in the inside of a face.
  bool NearFace(const Triangle3d& t, double limit, double scale) const;
  bool NearEdge(const Triangle3d& t, double distance, double scale) const;

  std::vector<Plane> planes_;
  std::vector<Line> edges_;
  Box3d bounds_;  // infinite where the polyhedron is
};

// The half-spaces of a box that is not empty.
std::vector<HalfSpace> BoxHalfSpaces(const Box3d& box);

}  // namespace mtdb::internal
