// SPDX-License-Identifier: Apache-2.0
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

  // Budgets. With any of them the permitted error is max(threshold, s w), place by place, and s
  // falls in steps of an eighth of an octave, from cluster to cluster, coarse ones first, until the
  // threshold is met or the next step does not fit a budget. The weight w is a pixel of the
  // threshold's camera (Threshold::AtPixels), so that the error is even in the picture; without a
  // camera it is 1. The answer has at least the root mesh. Its error_bound says which error was
  // reached, and its limit what ended the refinement.
  //
  // The mesh has at most this many triangles, counted before clipping. It is the least cut for the
  // last step that fits, for all of a cluster: whatever came before. A few may be left over, at
  // most what one cluster gains from an eighth of an octave.
  std::optional<uint64_t> max_triangles;
  // The query reads at most this many bytes of payloads from the store, besides the root pieces,
  // which it reads in any case. What is in the cache costs nothing, and what was read is kept till
  // the end of the query, so that nothing is read twice. The query fails with kBudgetExceeded when
  // other queries drop clusters from the cache that it had found there, and reading them again
  // would exceed the budget.
  std::optional<uint64_t> max_bytes;
  // Wall time. The search stops at the first node or cluster after it. Summing up the errors and
  // emitting the mesh comes on top, some 20 ns a triangle and the sink's time.
  std::optional<double> max_milliseconds;

  // Takes what is there: the answer is the least cut through the clusters in memory, at once. The
  // nodes of a cluster that is missing do not take part; a triangle that they would remove is
  // valid, and e(t) is the cluster's largest error. Stats say which clusters are missing; they have
  // been asked for, and come while nobody waits. The query fails with kNotYet as long as not all of
  // the root is there. What the cut uses stays in memory until the Cut is gone. Clusters that the
  // cache has no room for are missing, too. Of a source that answers at once (a store) the cache's
  // threads read, or without threads the query itself. Not with max_bytes (kInvalidArgument).
  // Sessions: see SessionOptions.
  bool available_only = false;

  // Leaves out triangles that do not meet the region, and vertices that only such triangles use.
  bool clip = false;

  // Adds the attributes nx, ny, nz (float32, the last of the row) to each vertex. They are the unit
  // vector of the sum of the normals of the vertex's triangles times their areas; all triangles of
  // the cut count, also those that are clipped away. Where the sum is 0 they are (0, 0, 1). Takes
  // 24 bytes a vertex and another pass over the clusters. An object that has normals of its own
  // (FindNormals) keeps them. kInvalidArgument when it has other attributes of these names.
  bool normals = false;

  // Lets other threads watch and cancel the query. Must outlive the query and its Cut. May be null.
  QueryControl* control = nullptr;
};

}  // namespace mtdb
