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
// A question is answered exactly, up to rounding, unless a kind of region says that it cannot be
// done; the answer then errs to the safe side: Within to true, Covers to false. So complements and
// combinations of safe answers are safe.
//
// Contract of an implementation: as `distance` grows, Within and BoxWithin never change from true
// to false, Covers and BoxCovers never from false to true. For a triangle t inside a box b,
// BoxWithin(b, d) is true whenever Within(t, d) is, and BoxCovers(b, d) only when Covers(t, d) is.
class Region {
 public:
  virtual ~Region() = default;
  // True when some point of the triangle is at most `distance` (>= 0) away from the region.
  virtual bool Within(const Triangle3d& t, double distance) const = 0;
  // True when every point at most `distance` away from the triangle is inside of the region, not
  // on its border: the triangle is farther than `distance` from all that is outside.
  virtual bool Covers(const Triangle3d& t, double distance) const = 0;
  // The same for all triangles inside a box: false only if none of them is within `distance`, ...
  virtual bool BoxWithin(const Box3d& box, double distance) const = 0;
  // ... true only if all of them are covered.
  virtual bool BoxCovers(const Box3d& box, double distance) const = 0;
  // True when the region is all of space, so that the geometry need not be looked at.
  virtual bool whole() const { return false; }
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
// The convex polyhedron in which all of `half_spaces` meet, bounded or not; at most
// kMaxHalfSpaces. It may be flat, or empty. Planes at an angle below 1e-9 count as parallel. Cost:
// the few triangles that are neither clearly in nor clearly out take one step per edge.
RegionPtr ConvexRegion(const std::vector<HalfSpace>& half_spaces);
// What is in sight of the camera, between its near and far: a convex polyhedron.
RegionPtr FrustumRegion(const Camera& camera);
// What lies above, below or inside of the camera's frustum: its shadow along z, a vertical convex
// prism. For terrain. The camera's `far` must be finite.
RegionPtr FrustumShadowRegion(const Camera& camera);
// The vertical wedge over the points of the plane whose direction from `apex` is at most half of
// `angle_rad` (above 0, below pi) from `direction`, and whose depth along it is between `near`
// and `far`. For terrain.
struct Wedge {
  double apex_x = 0, apex_y = 0;
  double direction_x = 0, direction_y = 1;  // any length above 0
  double angle_rad = 0.8;
  double near = 0;  // >= 0
  double far = std::numeric_limits<double>::infinity();
};
RegionPtr WedgeRegion(const Wedge& wedge);
// The vertical prism over a polygon of at least 3 corners {x, y}, in either order, not necessarily
// convex, from min_z to max_z. Where the polygon crosses itself, what an even number of its turns
// surrounds is outside. Cost per question: about logarithmic in the number n of corners where edges
// do not cross; at worst, where they all cross each other or end at all heights, about n^(3/4).
RegionPtr PrismRegion(const std::vector<std::array<double, 2>>& polygon,
                      double min_z = -std::numeric_limits<double>::infinity(),
                      double max_z = std::numeric_limits<double>::infinity());

RegionPtr PointRegion(Vec3d point);
// A segment: a line of sight.
RegionPtr SegmentRegion(Vec3d from, Vec3d to);
// What is at most `radius` away from a line of at least one point. A negative radius meets
// nothing. Covers is decided on eighths of the triangle, each in the tube around one segment. Cost
// per question: likewise in the number of points.
RegionPtr TubeRegion(const std::vector<Vec3d>& line, double radius);

// Of regions that are decided on eighths of a triangle and lie within each other, only the
// innermost are; the others are decided on the whole triangle.
//
// What lies in at least one of `regions`. Covers is decided on eighths of the triangle, each in one
// of the regions.
RegionPtr UnionRegion(std::vector<RegionPtr> regions);
// What lies in all of `regions`; without any, all of space. Boxes and convex polyhedra among them
// become one polyhedron, as long as they have at most kMaxHalfSpaces together: exact. For others
// Within is decided on eighths of the triangle, each within `distance` of every region: true when
// the regions are near the triangle but nowhere meet.
RegionPtr IntersectionRegion(std::vector<RegionPtr> regions);
// What lies outside of `region`, and its border. As exact as `region` is.
RegionPtr ComplementRegion(RegionPtr region);

}  // namespace mtdb
