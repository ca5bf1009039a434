// SPDX-License-Identifier: Apache-2.0
// MeshCut: cuts some of a window's triangles in two along the mesh, and counts what a cut parts.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/disk/tile.h"

namespace mtdb::internal {

// Where triangles are long and thin, two that share an edge may lie farther apart than thousands
// that follow each other beside them. So distances here are steps from triangle to triangle across
// edges. What is a vertex and an edge is known from the window's triangles alone. Work of one
// thread.
class MeshCut {
 public:
  explicit MeshCut(std::span<const TileTriangle> window);

  struct Seam {
    uint32_t vertices = 0;  // that both sides have
    uint32_t fewest = 0;    // that a side has
    // Compact cuts of scans stay far below.
    bool is_long() const { return uint64_t{kLong} * vertices > fewest; }
  };
  // Of triangles of the window: the first `middle` and the others.
  Seam SeamOf(std::span<const uint32_t> triangles, size_t middle);
  // Puts triangles of the window, which come in ascending order, in that of a walk across their
  // edges, nearest first, which begins at an end of the mesh; parts that do not hang together
  // follow each other.
  std::vector<uint32_t> Walk(std::span<const uint32_t> triangles);
  // About what it takes for a triangle, at most.
  static constexpr uint64_t kTriangleBytes = 64;

 private:
  static constexpr uint32_t kLong = 4;
  // Appends what hangs together with `first` and has not been reached in this walk.
  void WalkFrom(uint32_t first, uint32_t walk, std::vector<uint32_t>& order);

  std::vector<std::array<uint32_t, 3>> corners_;  // local vertices
  std::vector<uint32_t> opposites_;               // of half-edges; when first needed
  uint32_t vertices_ = 0;
  std::vector<uint32_t> sides_;    // of vertices: the last two that had it
  std::vector<uint32_t> reached_;  // of triangles: the last walk that has it
  uint32_t marks_ = 0;
};

// Whether a tile's triangles have most of their corners at vertices that other tiles of the window
// have, too. `tiles`: of the window's triangles.
bool HasLongSeams(std::span<const TileTriangle> window, std::span<const uint32_t> tiles,
                  uint32_t tile_count);

}  // namespace mtdb::internal
