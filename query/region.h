// Region: where a query wants accuracy. Small immutable objects, shared and composed freely.
#pragma once

#include <memory>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb {

// A closed set of points in model units. Immutable; safe for many threads.
//
// Contract of an implementation: Within is monotone in `distance` (true stays true as it grows),
// and BoxWithin(b, d) is true whenever Within(t, d) is for a triangle t inside b.
class Region {
 public:
  virtual ~Region() = default;
  // True when some point of the triangle is at most `distance` (>= 0) away from the region. Exact
  // up to rounding; the same arguments always give the same answer.
  virtual bool Within(const Triangle3d& t, double distance) const = 0;
  // False only if no triangle inside the box can be within `distance`.
  virtual bool BoxWithin(const Box3d& box, double distance) const = 0;
  // True only if all points within `distance` of the box are in the region.
  virtual bool BoxCovers(const Box3d&, double /*distance*/) const { return whole(); }
  // True when the region is all of space, so that the geometry need not be looked at.
  virtual bool whole() const { return false; }
};

using RegionPtr = std::shared_ptr<const Region>;

// All of space. A null RegionPtr in a Query means the same.
RegionPtr WholeRegion();
// A closed axis-aligned box. An empty box meets nothing.
RegionPtr BoxRegion(const Box3d& box);
// A closed ball; a negative radius meets nothing.
RegionPtr SphereRegion(Vec3d centre, double radius);
// What lies in at least one of `regions`.
RegionPtr UnionRegion(std::vector<RegionPtr> regions);

}  // namespace mtdb
