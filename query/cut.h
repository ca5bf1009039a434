// Cut: the answer to a query: the set of applied nodes, and its mesh.
#pragma once

#include <cstdint>
#include <memory>

#include "store/base/ids.h"
#include "store/base/mesh_sink.h"
#include "store/base/shortfall.h"
#include "store/base/status.h"

namespace mtdb {

class CutImpl;

// What ended the refinement of a query.
enum class QueryLimit : uint8_t { kThreshold, kTriangles, kBytes, kTime };

// What a query returned and what it cost.
struct ExtractStats {
  uint64_t triangles = 0;  // of the mesh that is emitted: after clipping
  uint64_t vertices = 0;   // likewise
  // Those within b(t) of the region. Where the cluster of a triangle's remover was not needed, its
  // largest error stands for e(t), here and below.
  uint64_t active_triangles = 0;
  // Model units: the largest b(t) over the active triangles; without any, of those that no node
  // removes. In the region, mesh and input (as it was before rounding) are that close, both ways.
  double error_bound = 0;
  Shortfall shortfall;  // of the active triangles
  QueryLimit limit = QueryLimit::kThreshold;
  uint64_t nodes_visited = 0;  // of the clusters that were looked into
  uint64_t nodes_applied = 0;
  uint64_t nodes_forced = 0;     // remove no active invalid triangle: applied only as ancestors
  uint64_t clusters_read = 0;    // payloads that this query read from the source
  uint64_t clusters_cached = 0;  // clusters that were decoded already when it first wanted them
  uint64_t clusters_used = 0;    // those with an applied node
  uint64_t clusters_total = 0;   // of the object
  uint64_t bytes_read = 0;       // payloads of clusters and root pieces
  struct Seconds {
    double select = 0;  // without load
    double load = 0;    // the query's thread: reading, decoding, waiting
    double read = 0;    // of all threads that read and decode for the query
    double decode = 0;  // likewise
    double emit = 0;    // without load; includes the sink's time
  } seconds;
};

// A conforming mesh of the whole surface (or its clipped part), before it is written out. Keeps
// some bits per triangle of the clusters that it uses, not the clusters. Movable; used by one
// thread at a time. Keeps the surface alive.
class Cut {
 public:
  explicit Cut(std::unique_ptr<CutImpl> impl);
  Cut(Cut&&) noexcept;
  Cut& operator=(Cut&&) noexcept;
  ~Cut();

  bool applied(UnitId cluster, NodeIndex node) const;
  uint64_t applied_count() const { return stats().nodes_applied; }
  uint64_t triangle_count() const { return stats().triangles; }
  uint64_t vertex_count() const { return stats().vertices; }
  double error_bound() const { return stats().error_bound; }
  const ExtractStats& stats() const;

  // Sends the mesh: all vertices (those of the root, then those of the clusters in ascending
  // order), then all triangles, active ones first, in blocks. Adds to stats() what it reads. May be
  // called again. Errors: the sink's, and those of reading clusters.
  Status Emit(MeshSink& sink);

 private:
  std::unique_ptr<CutImpl> impl_;
};

}  // namespace mtdb
