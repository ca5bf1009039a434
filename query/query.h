// Query: what a caller asks of a surface.
#pragma once

#include <cstdint>
#include <optional>

#include "query/region.h"
#include "query/threshold.h"

namespace mtdb {

// "This region, at this accuracy, within this budget." The default asks for everything.
//
// Let e(t) be the error of a triangle t: the error of the node that removes it, 0 if none does. t
// is active when its distance to the region is at most e(t). An active t is valid when no node
// removes it or e(t) <= the threshold everywhere within e(t) of t. The answer is the least
// parent-closed set of nodes in whose mesh every active triangle is valid; it is unique.
struct Query {
  RegionPtr region;        // null: all of space
  ThresholdPtr threshold;  // null: full resolution

  // Not more triangles than this (before clipping). Largest errors are refined first (ties: the
  // coarser cluster, then the smaller node) until the next node, with its missing ancestors, would
  // not fit or the threshold is met. The root mesh is returned even when it is larger: the
  // achieved error is in the answer's error_bound.
  std::optional<uint64_t> max_triangles;

  // Leaves out triangles that do not meet the region, and the vertices that only they use.
  bool clip = false;
};

}  // namespace mtdb
