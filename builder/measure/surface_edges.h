// SPDX-License-Identifier: Apache-2.0
// SurfaceEdges: the edges of the surface S that errors are measured against, and the paths that
// they follow over the tile's mesh.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "store/base/ids.h"

namespace mtdb::internal {

// A path is a sequence of crossings (MeshCrossings). Work of one thread.
class SurfaceEdges {
 public:
  // What is read of one lies in half a cache line.
  struct alignas(32) Edge {
    static constexpr uint32_t kShort = 3;
    uint32_t from = 0, to = 0;  // from the end with the smaller number in the input to the other
    float error = 0;            // the largest that its triangles have accumulated
    uint32_t length = 0;        // of its path
    // The path; of a longer one, where it is in pool_, and for how many there is room.
    std::array<uint32_t, kShort> crossings{};
    uint32_t looked_at_in = 0;  // the last hole
  };
  struct EdgeAt {  // a vertex
    uint32_t begins_here : 1 = 0;
    uint32_t edge : 31 = 0;
    uint32_t other_end = 0;
  };

  // Of S, see SurfaceMap::Build: edges without paths.
  void Build(std::span<const std::array<uint32_t, 3>> triangles,
             std::span<const uint32_t> opposites, std::span<const float> errors,
             std::span<const uint32_t> numbers);
  // Another one, which At() does not find.
  uint32_t Add(uint32_t from, uint32_t to);
  uint32_t size() const { return static_cast<uint32_t>(edges_.size()); }
  Edge& operator[](uint32_t e) { return edges_[e]; }
  const Edge& operator[](uint32_t e) const { return edges_[e]; }
  void PrefetchAt(uint32_t vertex) const { __builtin_prefetch(&begin_[vertex]); }
  std::span<const EdgeAt> At(uint32_t vertex) const {
    return std::span(at_).subspan(begin_[vertex], begin_[vertex + 1] - begin_[vertex]);
  }
  uint32_t Find(uint32_t from, uint32_t to) const;  // kNone32: there is none

  std::span<const uint32_t> path(const Edge& edge) const {
    if (edge.length <= Edge::kShort) return std::span(edge.crossings).first(edge.length);
    return std::span(pool_).subspan(edge.crossings[0], edge.length);
  }
  void SetPath(uint32_t e, std::span<const uint32_t> path);
  // Where paths have left much room that no other can use.
  void DropUnused();

 private:
  std::vector<Edge> edges_;
  std::vector<uint32_t> begin_;  // of the vertices, in at_
  std::vector<EdgeAt> at_;
  std::vector<uint32_t> pool_;  // paths that are not short
  size_t pool_unused_ = 0;
};

}  // namespace mtdb::internal
