// SPDX-License-Identifier: Apache-2.0
// CutImpl: what stands behind Cut: the selected nodes, the numbering of the output, the emission.
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "query/answer/block_writer.h"
#include "query/answer/kept_triangles.h"
#include "query/answer/root_numbering.h"
#include "query/cache/unit_reader.h"
#include "query/cut.h"
#include "query/cut/cut_state.h"
#include "query/cut/search.h"
#include "query/query.h"
#include "query/surface.h"

namespace mtdb::internal {

class CutImpl {
  // What is emitted of a unit. The output's numbers of its vertices: those of Nodes() are counted
  // from `first` on.
  struct Output {
    Bits kept;  // per own slot, when clipped
    Bits used;  // per node, likewise
    VertexIndex first = 0;
    const uint64_t* nodes = nullptr;  // null: all
    std::vector<uint32_t> ranks;      // flags before each word of `nodes`

    VertexIndex Of(NodeIndex node) const {
      if (nodes == nullptr) return first + node;
      const uint64_t below = nodes[node >> 6] & ((uint64_t{1} << (node & 63)) - 1);
      return first + ranks[node >> 6] + PopCount(below);
    }
  };

 public:
  // Of the mesh of any query, without its counts and pages.
  static MeshHeader HeaderOf(const ObjectRecord& record);
  // The threshold is kept when whoever takes the mesh moves its vertices by up to `sink_rounding`.
  CutImpl(std::shared_ptr<const Surface> surface, const Query& query, double sink_rounding);

  Status Select();
  Status Emit(MeshSink& sink);
  bool applied(UnitId cluster, NodeIndex node) const;
  const ExtractStats& stats() const { return stats_; }

 private:
  // The whole surface at full resolution needs no state: every node is applied, the drain is left.
  bool WantsEverything() const;
  // Normals are asked for, and the object has none of its own.
  bool MakesNormals() const;
  void FillStats();
  // What the answer promises when the sink moves vertices by up to `rounding`, whatever was
  // expected.
  void SetBounds(double rounding);
  // Each root piece, then each cluster with something in the output.
  std::vector<UnitId> OutputUnits() const;
  // Calls f(unit) for each of them. Holds one at a time, and none when `after` has it sent.
  template <typename F, typename After>
  Status ForEachUnit(std::span<const UnitId> units, F&& f, After&& after);
  // Marks the triangles that meet the region, and their vertices.
  Status MarkClipped();
  Status NumberVertices();

  Status EmitVertices(std::span<const UnitId> units, BlockWriter& out);
  // Active triangles, or the others.
  Status EmitTriangles(std::span<const UnitId> units, BlockWriter& out, bool active);
  // What EmitTriangles sends of unit `i`. False when it will need the unit.
  bool KeepTriangles(const LoadedUnit& unit, size_t i);
  void EmitRootVertices(const LoadedUnit& unit, BlockWriter& out, uint64_t* next) const;
  void EmitClusterVertices(const LoadedUnit& unit, BlockWriter& out) const;
  // Into `next`, which has room for the unit's own slots. Returns their end.
  TriangleVertices* PutTriangles(const LoadedUnit& unit, bool active, TriangleVertices* next);
  // Likewise the corners of a textured object's.
  void PutCorners(const LoadedUnit& unit, bool active, BlockWriter& out);
  // Of all vertices of the output, in their order.
  Status FindNormals(std::vector<Vec3f>* normals);
  // Calls f(local vertices) for each triangle of the unit in `slots`, which has a bit per own slot.
  template <typename F>
  void ForEachTriangle(const LoadedUnit& unit, std::span<const uint64_t> slots, F&& f);
  // Fills creators_ where an own slot may be in the output.
  void FindCreators(const LoadedUnit& unit);
  // Fills numbers_: the output's numbers of the unit's own vertices, kUnset for the others.
  void NumberOwn(const LoadedUnit& unit);
  bool InOutput(VertexIndex vertex, UnitId owner) const;
  // Calls f(node) for each node of the cluster whose vertex is in the output, ascending.
  template <typename F>
  void ForEachNode(const LoadedUnit& unit, F&& f) const {
    if (!everything_) return Nodes(unit.id).ForEach(f);
    for (NodeIndex i = 0; i < unit.nodes(); ++i) f(i);
  }
  // The output's number of a vertex that another unit brings.
  VertexIndex NumberOf(VertexIndex vertex, UnitId owner) const;
  // Likewise, of a local vertex; notes it in numbers_.
  VertexIndex NumberOther(const LoadedUnit& unit, uint32_t local);

  // True when nothing of this unit is in the output, so that it need not be loaded.
  bool Skips(UnitId unit) const;
  // Bits per own slot: what is emitted of the unit's active triangles, or of the others.
  std::span<const uint64_t> Slots(const LoadedUnit& unit, bool active);
  const Bits& Nodes(UnitId unit) const {
    return clip_ || !output(unit).used.empty() ? output(unit).used : cut_.Find(unit)->applied;
  }
  Output& output(UnitId unit) { return outputs_[cut_.Find(unit)->place]; }
  const Output& output(UnitId unit) const { return outputs_[cut_.Find(unit)->place]; }

  const std::shared_ptr<const Surface> surface_;
  const ClusterIndex& index_;
  const Query query_;
  const double rounding_;       // at ingest, model units
  const double sink_rounding_;  // expected
  const bool clip_;
  bool everything_ = false;
  bool numbered_ = false;
  CutState cut_;
  Search::Outcome outcome_;
  Bits root_used_;  // per root vertex, when clipped
  RootNumbering root_numbers_;
  std::vector<Output> outputs_;  // per place in cut_.open()
  // Lists by unit of the output, where the cache has no room for all: active triangles, the others.
  std::array<KeptTriangles, 2> kept_;
  size_t keeps_ = 0;                       // of these, in the answer that is emitted
  std::vector<TriangleVertices> to_keep_;  // scratch
  std::vector<VertexIndex> numbers_;       // scratch: per local vertex
  std::vector<NodeIndex> creators_;        // scratch: per own slot
  std::vector<uint64_t> inactive_;         // scratch: a bit per own slot
  UnitReader reader_;
  ExtractStats stats_;
};

}  // namespace mtdb::internal
