// SPDX-License-Identifier: Apache-2.0
// Region: where a query wants accuracy. Small immutable objects, shared and composed freely.
#pragma once

#include <array>
#include <limits>
#include <memory>
#include <vector>

#include "query/camera.h"
#include "store/base/geometry.h"

namespace mtdb {

// A closed set of points in model units. Immutable; safe for many threads. The same arguments
// always give the same answer.
//
// Answers are exact, up to rounding, unless the comment of a kind of region says otherwise. An
// answer that is not exact errs to the safe side: Within says true when in doubt, Covers says
// false. So the answers of complements and combinations are safe too.
//
// Contract of an implementation: as `distance` grows, Within and BoxWithin never change from true
// to false, Covers and BoxCovers never from false to true. For a triangle t inside a box b,
// BoxWithin(b, d) is true whenever Within(t, d) is, and BoxCovers(b, d) only when Covers(t, d) is.
class Region {
 public:
  virtual ~Region() = default;
  // True when some point of the triangle is at most `distance` (>= 0) away from the region.
  virtual bool Within(const Triangle3d& t, double distance) const = 0;
  // True when every point that is at most `distance` away from the triangle is inside of the region
  // and not on its border.
  virtual bool Covers(const Triangle3d& t, double distance) const = 0;
  // For all triangles inside a box at once: false only if Within is false of each of them.
  virtual bool BoxWithin(const Box3d& box, double distance) const = 0;
  // Likewise: true only if Covers is true of each of them.
  virtual bool BoxCovers(const Box3d& box, double distance) const = 0;
  // True when the region is all of space, so that nobody need ask about triangles.
  virtual bool whole() const { return false; }
  // How deep inside of the region all of the box is: for d < Depth, BoxCovers(box, d) is true. Or,
  // negative, how far outside: for d < -Depth, BoxWithin(box, d) is false. 0 where the border may
  // be, or nothing is known.
  virtual double Depth(const Box3d& box) const;
  // How far the border may have moved, between this region and `to`: the depth of no box inside
  // `within` differs by more. Infinite when that is not known, as by default of two regions; 0 only
  // when both say the same of all triangles inside `within`.
  virtual double Shift(const Region& to, const Box3d& within) const;
};

using RegionPtr = std::shared_ptr<const Region>;

// Coordinates given to the functions below must be finite.

// All of space. A null RegionPtr in a Query means the same.
RegionPtr WholeRegion();
// A closed axis-aligned box. An empty box meets nothing.
RegionPtr BoxRegion(const Box3d& box);
// A closed ball; a negative radius meets nothing.
RegionPtr SphereRegion(Vec3d centre, double radius);

// The points behind a plane: those p with Dot(p - point, normal) <= 0.
struct HalfSpace {
  Vec3d point;   // of the plane
  Vec3d normal;  // points out; any length above 0
};
constexpr size_t kMaxHalfSpaces = 64;
RegionPtr HalfSpaceRegion(const HalfSpace& half_space);
// The convex polyhedron that lies in all of `half_spaces`, of which there are at most
// kMaxHalfSpaces. It may be unbounded, flat or empty. Planes at an angle below 1e-9 count as
// parallel. Cost: one step per edge of the polyhedron for triangles that are neither clearly in nor
// clearly out, which are few.
RegionPtr ConvexRegion(const std::vector<HalfSpace>& half_spaces);
// What is in sight of the camera, between its near and far: a convex polyhedron.
RegionPtr FrustumRegion(const Camera& camera);
// What lies above, below or inside of the camera's frustum: its shadow along z, a vertical convex
// prism. For terrain. The camera's `far` must be finite.
RegionPtr FrustumShadowRegion(const Camera& camera);
// For terrain: the points above and below a wedge in the plane. A point (x, y) is in the wedge when
// the angle between `direction` and the direction from `apex` to it is at most half of `angle_rad`
// (above 0, below pi), and its distance from `apex` along `direction` is between `near` and `far`.
struct Wedge {
  double apex_x = 0, apex_y = 0;
  double direction_x = 0, direction_y = 1;  // any length above 0
  double angle_rad = 0.8;
  double near = 0;  // >= 0
  double far = std::numeric_limits<double>::infinity();
};
RegionPtr WedgeRegion(const Wedge& wedge);
// The vertical prism over a polygon of at least 3 corners {x, y}, clockwise or counter-clockwise,
// not necessarily convex, from min_z to max_z. Where the polygon crosses itself, a point that it
// winds around an even number of times is outside. Cost per question: about logarithmic in the
// number n of corners when edges do not cross; at worst, when all edges cross each other or end at
// all heights, about n^(3/4).
RegionPtr PrismRegion(const std::vector<std::array<double, 2>>& polygon,
                      double min_z = -std::numeric_limits<double>::infinity(),
                      double max_z = std::numeric_limits<double>::infinity());

RegionPtr PointRegion(Vec3d point);
// A segment: a line of sight.
RegionPtr SegmentRegion(Vec3d from, Vec3d to);
// Tubes, unions and intersections cannot answer every question exactly. They split the triangle
// into parts, down to sides of an eighth, and ask about the parts. When regions that split contain
// each other, only the innermost split; the others ask about the whole triangle.

// What is at most `radius` away from a line of at least one point. A negative radius meets nothing.
// Covers is true only if parts that the tube around a single segment covers make up the triangle.
// Cost per question: in the number of points as that of PrismRegion in corners.
RegionPtr TubeRegion(const std::vector<Vec3d>& line, double radius);

// What lies in at least one of `regions`. Covers is true only if parts that a single region covers
// make up the triangle.
RegionPtr UnionRegion(std::vector<RegionPtr> regions);
// What lies in all of `regions`; without any, all of space. Boxes and convex polyhedra among them
// become one polyhedron, which is exact, as long as they have at most kMaxHalfSpaces together. With
// other regions, Within is true when some part of the triangle is within `distance` of every
// region; this can be so although the regions do not meet there.
RegionPtr IntersectionRegion(std::vector<RegionPtr> regions);
// What lies outside of `region`, and its border. Answers are as exact as those of `region`.
RegionPtr ComplementRegion(RegionPtr region);

inline Vec3d Scaled(Vec3d p, Vec3d scale) { return {p.x * scale.x, p.y * scale.y, p.z * scale.z}; }
// The points p of which Scaled(p, scale) lies in `region`; scales are above 0. Distances are asked
// after scaling: so it is for terrains, whose errors are heights, and scale.z is 1. Null stays
// null, and a scale of 1, 1, 1 changes nothing.
RegionPtr ScaledRegion(RegionPtr region, Vec3d scale);

}  // namespace mtdb
