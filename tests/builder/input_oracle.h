// SPDX-License-Identifier: Apache-2.0
// InputOracle: the definitions of what an input mesh is, edge by edge and vertex by vertex, counted
// naively. The oracle of the corner join, and the source of tiles for tests of the decimator.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <vector>

#include "builder/disk/tile.h"
#include "store/base/grid.h"
#include "store/base/mesh_sink.h"
#include "store/object_record.h"

namespace mtdb::testing {

using namespace internal;

struct InputOracle {
  using Edge = std::pair<VertexIndex, VertexIndex>;  // smaller end first
  static Edge Between(VertexIndex a, VertexIndex b) { return {std::min(a, b), std::max(a, b)}; }

  InputOracle(const std::vector<TriangleVertices>& input, uint64_t vertex_count);

  // One triangle, two that run along it in opposite directions, or two that are two-sided.
  bool IsManifold(const Edge& edge) const { return OrderOf(edge) < 2; }
  uint64_t BorderEdges() const;

  std::vector<TriangleVertices> kept;  // in the input's order, the smallest index first
  std::vector<bool> two_sided;         // of them; the opposite came later, and is not kept
  InputReport report;
  // By kept triangles; +1: runs from the smaller end to the larger; -1; 0: it is two-sided.
  std::map<Edge, std::vector<int>> uses;
  std::map<VertexIndex, std::vector<size_t>> at;  // kept triangles at a vertex
  std::set<VertexIndex> fixed;                    // at a non-manifold place, and on no chain
  std::map<VertexIndex, uint32_t> chains;  // vertices on chains of several triangles: how many
  std::map<VertexIndex, uint32_t> fans;    // of vertices with 2 .. kMostOrder: how many

  size_t OrderOf(const Edge& edge) const;
  std::vector<size_t> FanGroups(VertexIndex v) const;
  // The fans' groups in the order of their numbers.
  std::vector<size_t> SortedFans(VertexIndex v) const;
  uint32_t FirstNumber(VertexIndex v) const;

 private:
  size_t Fans(VertexIndex v) const;
  void FindChains();
  std::optional<uint32_t> ChainOrder(VertexIndex v) const;
};

// The kept triangles with flags and positions, as the builder's first round gets them.
std::vector<TileTriangle> ClassifiedTriangles(const TriangleMesh& mesh, const Grid& grid);

}  // namespace mtdb::testing
