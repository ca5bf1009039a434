// SPDX-License-Identifier: Apache-2.0
// Random regions of every kind, each with its definition in plain words: functions of points.
#pragma once

#include <functional>
#include <random>
#include <vector>

#include "query/region.h"

namespace mtdb::testing {

// What a region is, point by point.
struct RegionCase {
  const char* kind = "";
  RegionPtr region;
  // From a point to the region, and to all that is outside of it.
  std::function<double(Vec3d)> distance;
  std::function<double(Vec3d)> depth;
  // What is promised of Within and Covers; otherwise they only err to the safe side.
  bool within_is_exact = true;
  bool covers_is_exact = true;

  bool Contains(Vec3d p) const { return distance(p) <= 0; }
};

constexpr int kRegionKinds = 14;  // without the combined ones

// Of one kind, somewhere in the box and about as large as a third of it.
RegionCase RandomRegion(int kind, const Box3d& where, std::mt19937& random);
// Of unions, intersections and complements of the above. Distances of combined regions are those
// of their parts where that is right, and otherwise only tell inside (0) from outside (1).
RegionCase RandomCombination(const Box3d& where, std::mt19937& random);
// Either.
RegionCase AnyRegion(const Box3d& where, std::mt19937& random);
Camera RandomCamera(const Box3d& where, std::mt19937& random);

}  // namespace mtdb::testing
