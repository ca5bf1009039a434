// SPDX-License-Identifier: Apache-2.0
// Questions to parts of a triangle, for regions that are put together from others.
#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "query/fields/work_meter.h"
#include "query/region.h"

namespace mtdb::internal {

constexpr int kSplits = 3;  // down to eighths of the triangle's sides

// A region of which some questions go to parts of the triangle.
class SplittingRegion : public Region {
 public:
  virtual bool splits() const { return true; }
};

inline bool Splits(const RegionPtr& region) {
  const auto* splitting = dynamic_cast<const SplittingRegion*>(region.get());
  return splitting != nullptr && splitting->splits();
}

// How often a region made of others splits: not when they do. Else the cost would grow with the
// power of the depth.
inline int SplitsAround(const std::vector<RegionPtr>& regions) {
  return std::any_of(regions.begin(), regions.end(), Splits) ? 0 : kSplits;
}

// The four triangles between the corners and the middles of the edges.
inline std::array<Triangle3d, 4> Quarters(const Triangle3d& t) {
  const Vec3d ab = (t[0] + t[1]) * 0.5;
  const Vec3d bc = (t[1] + t[2]) * 0.5;
  const Vec3d ca = (t[2] + t[0]) * 0.5;
  return {{{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {bc, ca, ab}}};
}

// True when `holds` is true of some smallest part and of all parts around it.
template <typename F>
bool HoldsForSome(const Triangle3d& t, F&& holds, int splits) {
  if (!SpendSteps(1) || !holds(t)) return false;
  if (splits == 0) return true;
  for (const Triangle3d& part : Quarters(t)) {
    if (HoldsForSome(part, holds, splits - 1)) return true;
  }
  return false;
}

// True when parts of which `holds` is true make up the triangle.
template <typename F>
bool HoldsForAll(const Triangle3d& t, F&& holds, int splits) {
  if (holds(t)) return true;
  if (splits == 0 || !SpendSteps(1)) return false;
  for (const Triangle3d& part : Quarters(t)) {
    if (!HoldsForAll(part, holds, splits - 1)) return false;
  }
  return true;
}

}  // namespace mtdb::internal
