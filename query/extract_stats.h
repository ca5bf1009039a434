// SPDX-License-Identifier: Apache-2.0
// ExtractStats: what a query returned and what it cost.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "store/base/ids.h"
#include "store/base/shortfall.h"
#include "store/base/status.h"

namespace mtdb {

// What ended the refinement of a query; kMissing: clusters that are not in memory.
enum class QueryLimit : uint8_t { kThreshold, kTriangles, kBytes, kTime, kMissing };

// A cluster, or a piece of the root, that a query lacked which takes what is there.
struct MissingCluster {
  enum class Reason : uint8_t {
    kNotRead,  // it, or what it comes from, has not come or is not decoded
    kNoRoom,   // the cache has no room to keep it beside what the query uses
    kFailed,   // its bytes cannot be had, or are damaged
  };
  UnitId unit = 0;
  // The largest bound b(t) that it, or a missing cluster that comes from it, leaves in the mesh.
  double error = 0;
  // This over the least threshold where the cluster lies; infinite where that is 0.
  double excess = 0;
  Reason reason = Reason::kNotRead;
  Status failure;  // of kFailed
};

// What a query returned and what it cost.
struct ExtractStats {
  uint64_t triangles = 0;  // of the mesh that is emitted: after clipping
  uint64_t vertices = 0;   // likewise
  // How many triangles of the mesh are active: within b(t) of the region (query/query.h). A
  // triangle's e(t) is known when the cluster of its remover was loaded; otherwise, here and below,
  // the largest error of that cluster stands for it.
  uint64_t active_triangles = 0;
  // The largest b(t) of the active triangles, in model units; when none is active, b(t) of a
  // triangle that no node removes. In the region, no point of the mesh is farther than this from
  // the input as it was before rounding, and no point of the input farther from the mesh.
  double error_bound = 0;
  // How far the rest of the mesh and the input are apart at most, outside of the region; nothing
  // when there is no such rest: without a region, and when the query clips. An upper bound by the
  // clusters that the mesh could still be refined with. Not of sessions.
  std::optional<double> error_bound_outside;
  Shortfall shortfall;  // of the active triangles
  // Of a query that takes what is there: what it lacked, the largest `excess` first, then the
  // largest error, and parents before children. Empty: the cut is that of a query that waits.
  std::vector<MissingCluster> missing;
  QueryLimit limit = QueryLimit::kThreshold;
  uint64_t nodes_visited = 0;  // of all clusters that the search looked into
  uint64_t nodes_applied = 0;
  uint64_t nodes_forced = 0;   // applied only as ancestors: they remove no active invalid triangle
  uint64_t clusters_read = 0;  // whose payloads this query read from the source
  uint64_t clusters_cached = 0;  // that were decoded already when the query first wanted them
  uint64_t clusters_used = 0;    // that have an applied node
  uint64_t clusters_total = 0;   // of the object
  uint64_t bytes_read = 0;       // payloads of clusters and root pieces
  struct Seconds {
    double select = 0;  // finding the cut, without `load`
    double load = 0;    // reading, decoding and waiting by the query's own thread
    double read = 0;    // reading, by all threads that work for the query
    double decode = 0;  // decoding, likewise
    double emit = 0;    // sending the mesh, with the sink's time, without `load`
  } seconds;
};

}  // namespace mtdb
