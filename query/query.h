// Query: what a caller asks of a surface.
#pragma once

#include <cstdint>
#include <optional>

#include "query/region.h"
#include "query/threshold.h"

namespace mtdb {

class QueryControl;

// "This region, at this accuracy, within this budget." The default asks for everything.
//
// Let e(t) be the error of a triangle t: the error of the node that removes it, 0 if none does; h
// what rounding displaced (ObjectRecord::rounding_error, and MeshSink::LargestRounding of the sink
// that Surface::Extract has); b(t) = e(t) + h its bound. t is active when its distance to the
// region is at most b(t). An active t is valid when no node removes it or b(t) <= the threshold
// everywhere within b(t) of t, where a threshold from 0 to h counts as h: nothing better is to be
// had, and the answer's shortfall says so. The answer is the least parent-closed set of nodes in
// whose mesh every active triangle is valid; it is unique.
struct Query {
  RegionPtr region;        // null: all of space
  ThresholdPtr threshold;  // null: full resolution

  // Budgets. With any of them the largest errors are refined first (ties: the coarser cluster, then
  // the smaller node) until the threshold is met or the next step does not fit; the root mesh is
  // returned in any case. The achieved error is in the answer's error_bound, what ended the
  // refinement in its limit. Not more triangles than this, before clipping:
  std::optional<uint64_t> max_triangles;
  // Payload bytes that this query reads from the store. Hard, but for the root pieces, which are
  // read in any case. What is in the cache costs nothing; what was read is kept till the end of the
  // query, so that nothing is read twice. When other queries drop from the cache what this one has
  // found there, and reading it again exceeds the budget, the query fails with kBudgetExceeded.
  std::optional<uint64_t> max_bytes;
  // Wall time. The search stops at the first node or cluster after it; then the errors are summed
  // up and what was selected is emitted, which takes some 20 ns a triangle and the sink's time.
  std::optional<double> max_milliseconds;

  // Leaves out triangles that do not meet the region, and the vertices that only they use.
  bool clip = false;

  // Adds the attributes nx, ny, nz (float32, the last of the row) to each vertex: the unit vector
  // of the sum of its triangles' normals times their areas, over all triangles of the cut, also
  // those that are clipped away; (0, 0, 1) where the sum is 0. Takes 24 bytes a vertex and another
  // pass over the clusters. kInvalidArgument when the object has attributes of these names.
  bool normals = false;

  // Progress and cancellation, from other threads. Must outlive the query and its Cut. May be null.
  QueryControl* control = nullptr;
};

}  // namespace mtdb
