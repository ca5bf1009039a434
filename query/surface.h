// SPDX-License-Identifier: Apache-2.0
// Surface: one object of a store, ready for queries. Start here.
//
//   auto database = mtdb::Database::Open("scans.mtdb");
//   auto source = (*database)->OpenObject("statue");
//   auto surface = mtdb::Surface::Open(*source);
//   mtdb::Query query;
//   query.region = mtdb::SphereRegion({0, 1.2, 0}, 0.3);
//   query.threshold = mtdb::ConstantThreshold(0.001);
//   mtdb::TriangleMesh mesh;
//   mtdb::TriangleMeshSink sink(&mesh);
//   auto stats = (*surface)->Extract(query, sink);
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "query/cut.h"
#include "query/query.h"
#include "query/runtime_form.h"
#include "store/base/mesh_sink.h"
#include "store/base/status.h"
#include "store/base/threading.h"
#include "store/cluster_source.h"
#include "store/object_record.h"

namespace mtdb {

namespace internal {
class ClusterCache;
}

struct SurfaceOptions {
  // The most memory that decoded clusters take, those in use included. Whether it is enough for a
  // query depends on the query and the object alone: not on what is cached or who else queries. A
  // step of a query needs room for the clusters that it uses at a time, and beside them for what
  // one of them is decoded from; kBudgetExceeded says how much. Beside it, a query takes
  // about a byte for each node of the clusters that it uses, and the blocks of its output; see
  // docs/design.md.
  size_t cache_bytes = size_t{256} << 20;
  // What the cache keeps between queries. The implicit form takes some 4 bytes a node and the
  // attributes, instead of 60; but each query decodes clusters anew, which takes 6 to 20 times as
  // long (docs/BENCHMARKS.md). It is for many open surfaces with few queries each. Answers do not
  // depend on it.
  RuntimeForm form = RuntimeForm::kExplicit;
  // That read and decode for one query, its own included. 0: as many as the machine has. Answers do
  // not depend on it.
  unsigned threads = 0;
  // False: a query that lacks a payload fails with kNotYet and leaves what it asked for on its way;
  // asked again when that has come, it goes on with what is in the cache. For callers that must
  // never stand still, and where there are no threads.
  bool waits = kThreads;
  // Where a query whose clusters do not fit the cache puts those that it will want again: a
  // temporary file without a name, of at most so many bytes, in this folder (empty: the system's).
  // It is gone with the query. Without it (0, or a full disk) they are decoded again.
  uint64_t spill_bytes = uint64_t{4} << 30;
  std::string tmp_directory = {};
};

// Safe for many threads, which share the cache. After De Floriani, Magillo, Puppo, "Efficient
// implementation of Multi-Triangulations" (1998); clusters, and the search that goes from cluster
// to cluster, are ours.
class Surface : public std::enable_shared_from_this<Surface> {
 public:
  // Reads nothing yet but checks that the index is a DAG. Errors: kCorrupt.
  static Result<std::shared_ptr<Surface>> Open(std::shared_ptr<ClusterSource> source,
                                               const SurfaceOptions& options = {});
  ~Surface();

  const ObjectRecord& record() const { return source_->record(); }
  const ClusterIndex& index() const { return source_->index(); }
  const std::shared_ptr<ClusterSource>& source() const { return source_; }
  // What its clusters take in memory now, and how many were decoded so far.
  struct CacheUse {
    size_t bytes = 0;
    uint64_t decoded = 0;
  };
  CacheUse cache_use() const;
  // For the library itself.
  internal::ClusterCache& cache() const { return *cache_; }

  // Finds the smallest cut for the query. Errors: those of reading clusters.
  Result<Cut> Select(const Query& query) const;
  // Select, then Emit. The whole surface at full resolution is streamed, cluster after cluster:
  // memory does not depend on its size.
  Result<ExtractStats> Extract(const Query& query, MeshSink& sink) const;

 private:
  Surface(std::shared_ptr<ClusterSource> source, const SurfaceOptions& options);
  const std::shared_ptr<ClusterSource> source_;
  const std::unique_ptr<internal::ClusterCache> cache_;
};

}  // namespace mtdb
