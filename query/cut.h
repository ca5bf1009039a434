// SPDX-License-Identifier: Apache-2.0
// Cut: the answer to a query: the set of applied nodes, and its mesh.
#pragma once

#include <cstdint>
#include <memory>

#include "query/extract_stats.h"
#include "store/base/ids.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb {

namespace internal {
class CutImpl;
}

// A conforming mesh of the whole surface, or the part of it that meets the region when the query
// clips. Emit sends it to a sink. Keeps some bits for each triangle of the clusters that it uses,
// not the clusters. Movable; used by one thread at a time. Keeps the surface alive.
class Cut {
 public:
  explicit Cut(std::unique_ptr<internal::CutImpl> impl);
  Cut(Cut&&) noexcept;
  Cut& operator=(Cut&&) noexcept;
  ~Cut();

  bool applied(UnitId cluster, NodeIndex node) const;
  uint64_t applied_count() const { return stats().nodes_applied; }
  uint64_t triangle_count() const { return stats().triangles; }
  uint64_t vertex_count() const { return stats().vertices; }
  double error_bound() const { return stats().error_bound; }
  const ExtractStats& stats() const;

  // Sends the mesh in blocks: all vertices (those of the root, then those of the clusters in
  // ascending order), then all triangles, active ones first. Adds what it reads to stats(). May be
  // called again. Errors: the sink's, and those of reading clusters.
  Status Emit(MeshSink& sink);

 private:
  std::unique_ptr<internal::CutImpl> impl_;
};

}  // namespace mtdb
