// SPDX-License-Identifier: Apache-2.0
// TileCutter: cuts a round's mesh, as it comes along the curve, into compact tiles.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "builder/disk/tile.h"
#include "builder/disk/triangle_sorter.h"
#include "builder/tiles/tiling.h"
#include "store/base/grid.h"
#include "store/base/status.h"

namespace mtdb::internal {

class MeshCut;

// Runs of the curve have winding borders. So a window, a run of several tiles, is cut in two again
// and again, across the axis along which its triangles lie farthest apart: seams are a quarter
// shorter. Where triangles are so long and thin that most vertices would lie on seams, it is cut
// along the mesh instead (MeshCut). Tiles depend on the round's triangles alone. A tile's triangles
// come along the curve, and the tiles of a window in the order of their first triangles.
class TileCutter {
 public:
  struct Options {
    uint64_t tiles = 1;
    uint32_t round = 1;
    uint64_t tile_triangles = 0;  // about; of the options
    size_t row_bytes = 0;         // of a vertex
    bool flat = false;            // places along the third axis do not count
  };
  // `sorter` has been finished.
  TileCutter(TriangleSorter& sorter, const RoundCurve& curve, const Grid& grid,
             const Options& options);

  // The next tile and the code of its first triangle; skipped when `tile` is null.
  Status Next(TriangleBlock* tile, uint64_t* code);

  // How many tiles a window has at most. Depends on what a build stores, and not on its memory.
  static uint64_t WindowTiles(uint64_t tile_triangles, size_t row_bytes);
  // What a window takes at most.
  static uint64_t WindowBytes(uint64_t tile_triangles, size_t row_bytes);

 private:
  // Three times a triangle's centre, from that of the window's first triangle.
  struct Centre {
    std::array<float, 3> at;
    uint32_t triangle;  // in the window
  };
  // Some of the window's triangles, which become so many tiles.
  struct Part {
    uint32_t begin, end;  // in centres_
    uint32_t tiles;
  };
  uint64_t WindowTriangles() const;
  Status ReadWindow();
  void MeasureCentres();
  // Sets parts_; where `mesh` is given, it mends cuts that have long seams.
  void Cut(uint32_t tiles, MeshCut* mesh);
  bool PartsHaveLongSeams() const;
  void MendSplit(const Part& part, uint32_t middle, MeshCut& mesh);
  // Puts the part's triangles that become its first `tiles` tiles before the others; returns where
  // those begin.
  uint32_t Split(const Part& part, uint32_t tiles);

  TriangleSorter& sorter_;
  const RoundCurve& curve_;
  const Grid& grid_;
  const Options options_;
  const uint64_t windows_;
  uint64_t window_ = 0;     // the one that the next tile is in
  uint64_t next_tile_ = 0;  // of the round
  bool read_ = false;       // the window is in block_
  TriangleBlock block_;
  std::vector<Centre> centres_;  // of its triangles, part by part
  std::vector<Part> parts_;      // its tiles
};

}  // namespace mtdb::internal
