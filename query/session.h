// SPDX-License-Identifier: Apache-2.0
// Session: a cut that moves from query to query, and the updates between. What a server keeps for a
// client; codecs/stream/update_stream.h sends the updates.
//
//   auto session = mtdb::Session::Open(surface);
//   mtdb::UpdateEncoder encoder(...);                  // for (*session)->Base()
//   std::vector<mtdb::UpdateBatch> batches;
//   (*session)->Update(query, &batches);
//   send(encoder.Encode(batches));
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "codecs/stream/mesh_update.h"
#include "query/cut.h"
#include "query/query.h"
#include "store/base/status.h"
#include "store/base/texture.h"

namespace mtdb {

class Surface;

// Takes the batches of one round of an update, in order. What it returns but ok ends the update.
using BatchSink = std::function<Status(std::span<const UpdateBatch>)>;

struct SessionUpdate {
  uint64_t insertions = 0;
  uint64_t removals = 0;
  // Of the new cut; `triangles` and `vertices` are those of the whole surface, `nodes_visited`
  // those that were looked at, `seconds.select` includes the sink's time. Clusters that are in use
  // still tell more of their errors than a search would learn: `active_triangles` and `error_bound`
  // may be below those of Surface::Select.
  ExtractStats stats;
};

// What is known of a triangle of a session's mesh.
struct TriangleFacts {
  // b(t), in model units (query/query.h); or, while the cluster that removes it is not in memory,
  // the largest that it can be.
  double error_bound = 0;
  bool exact = true;   // it is b(t)
  UnitId cluster = 0;  // that creates the triangle; from ClusterIndex::cluster_count() on: the root
};

// Where the corners of a triangle of a session's mesh lie in the image: corners[i] is the one at
// vertices[i], which an UpdateBatch may name in another order.
struct TriangleCorners {
  std::array<VertexIndex, 3> vertices{};
  std::array<TextureCorner, 3> corners{};
};

struct SessionOptions {
  // The session never waits: its cuts go through the clusters that are in memory, as with
  // Query::available_only, and refine from call to call as clusters come. Those that its cut uses
  // stay in memory. What Update lacked is in stats.missing, ordered by how much it would help, and
  // has been asked for; what earlier queries wanted and this one does not is not wanted any more.
  // Query::max_milliseconds is then the time of the call, and no budget: after it Update begins
  // with no further cluster, leaves a conforming cut on the way, says QueryLimit::kTime, and goes
  // on when it is called with the same region and threshold. At least one cluster is refined in a
  // call; what the new query takes away, and the updates that a call makes, are not counted.
  // With max_triangles a query that takes several calls is finished before a later one begins, so
  // that queries that change with each call get somewhere. The cut stays the one before while what
  // comes does not fit, and at first until it has as many triangles; its error_bound is then that
  // of the whole mesh.
  bool available_only = false;
};

// After De Floriani, Magillo, Puppo, "Efficient implementation of Multi-Triangulations" (1998), its
// dynamic update; how it finds what to take away is ours (docs/design.md). Used by one thread at a
// time; many sessions share a surface. Between updates it keeps some 6 bytes for each node of the
// clusters in use, and a pointer for each cluster.
class Session {
 public:
  // At the root. `surface` stays alive with the session.
  static Result<std::unique_ptr<Session>> Open(std::shared_ptr<const Surface> surface,
                                               const SessionOptions& options = {});
  ~Session();

  // The root mesh, which every session starts from. Errors: those of reading root pieces; kNotYet
  // of a session that does not wait, while it is on its way.
  Result<BaseMesh> Base() const;

  // Moves to the cut that Surface::Select finds for `query`, node for node, and sets `batches` to
  // the updates between: first removals, children before parents, then insertions, parents before
  // children; the updates of a batch do not depend on each other. Query::clip and Query::normals
  // are ignored: a session holds the whole surface. On an error, cancellation included, the cut is
  // the previous one. Errors: those of Surface::Select.
  //
  // Cost: in proportion to the updates and to the nodes whose decisions the new query may change,
  // which is told from Threshold::Change; a step of 1 ns for each node of the clusters in use.
  // Where a region ends, and everywhere for a threshold that cannot tell its change, all decisions
  // are made again; with a region, the active triangles are counted anew. With a budget of
  // triangles, which moves like any other query, what falls short is counted anew too. With other
  // budgets the search is a fresh one, and so is the next one without.
  Result<SessionUpdate> Update(const Query& query, std::vector<UpdateBatch>* batches);
  // Likewise, but hands the batches over round by round, so that they can be sent while the next
  // round is computed: removals with the first, insertions by falling errors, in a few rounds when
  // they are many. After each round the cut is the one that its batches lead to; after an error,
  // the sink's included, it is that of the last round whose batches the sink took.
  Result<SessionUpdate> Update(const Query& query, const BatchSink& sink);

  // Of a session that does not wait: what failed is asked for again.
  void RetryFailed();

  // Likewise: what is in memory of a triangle that the last update left in the mesh. Reads nothing.
  TriangleFacts FactsOf(TriangleKey key) const;
  // Likewise, of a textured object.
  TriangleCorners CornersOf(TriangleKey key) const;

  bool applied(UnitId cluster, NodeIndex node) const;
  uint64_t applied_count() const;

 private:
  class Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  const std::unique_ptr<Impl> impl_;
};

}  // namespace mtdb
