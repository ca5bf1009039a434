// SPDX-License-Identifier: Apache-2.0
// TileTree: which cells of an octree or quadtree are the tiles of each level.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/json.h"
#include "tools/tiles/level/level_mesh.h"

namespace mtdb {

// A cell of the tree that is a tile of a level. The tiles of a level cover what the surface reaches
// of space, and do not overlap; a tile's children are the tiles of the next level in its cell.
struct TreeTile {
  uint32_t depth = 0;  // of the cell; the root's is 0
  std::array<uint32_t, 3> cell{};
  uint32_t parent = 0;       // of the level before
  uint32_t first_child = 0;  // of the next level
  uint32_t children = 0;
  Box3d content;  // of what its file has, without skirts; set by who sorts triangles
};

// Cells are split until no tile has more than `most_triangles`, but at most so far in one level
// that a tile has 64 children; a level may leave a cell as it is. So levels need not halve
// anything.
class TileTree {
 public:
  // `quad`: cells are split in x and y only.
  TileTree(const Box3d& bounds, bool quad, uint64_t most_triangles);

  // Adds the tiles of the next level; a triangle belongs to a tile when it is within `margin` of
  // its cell, as a box around it says, and exactly so where it is long.
  void AddLevel(const LevelMesh& mesh, double margin);
  // Of the last level; at least one.
  void TilesOf(const Triangle3d& corners, std::vector<uint32_t>* tiles) const;
  Box3d CellOf(const TreeTile& tile) const;

  size_t levels() const { return levels_.size(); }
  std::vector<TreeTile>& level(size_t i) { return levels_[i].tiles; }
  const std::vector<TreeTile>& level(size_t i) const { return levels_[i].tiles; }
  double margin(size_t i) const { return levels_[i].margin; }

  Json State() const;
  // False, or UnexpectedJson (json_reading.h), where it is damaged.
  bool Restore(const Json& state);

 private:
  static constexpr uint32_t kParts = 64;  // of a cell: 4 x 4 x 4, or 8 x 8
  // A cell's corner, and parts of it a unit along each axis.
  struct CellFrame {
    Vec3d corner, parts;
  };
  struct Level {
    std::vector<TreeTile> tiles;
    double margin = 0;
    // For each part of each tile of the level before the tile that has it, or the nearest one.
    std::vector<uint32_t> tile_of_part;
    std::vector<CellFrame> frames;  // of the tiles
  };
  struct PartRange {
    std::array<uint32_t, 3> low{}, high{};
  };

  int axes() const { return quad_ ? 2 : 3; }
  uint32_t parts_per_axis() const { return quad_ ? 8 : 4; }
  uint32_t PartAt(std::array<uint32_t, 3> at) const {
    return at[0] + parts_per_axis() * (at[1] + (quad_ ? 0 : parts_per_axis() * at[2]));
  }
  std::array<uint32_t, 3> PlaceOf(size_t part) const {
    const uint32_t n = parts_per_axis();
    const auto at = static_cast<uint32_t>(part);
    return {at % n, at / n % n, at / n / n};
  }
  CellFrame FrameOf(const TreeTile& tile) const;
  void SetFrames(Level* level) const;
  PartRange PartsIn(const CellFrame& cell, const Box3d& box) const;
  Box3d BoxOfPart(const TreeTile& tile, std::array<uint32_t, 3> at) const;
  // Calls visit(tile of `level`, part) for what the triangle is within `margin` of.
  template <typename Visit>
  void Descend(size_t level, const Triangle3d& corners, double margin, const Visit& visit) const;
  template <typename Visit>
  void DescendFrom(size_t from, uint32_t tile, size_t level, const Triangle3d& corners,
                   const Box3d& box, double margin, const Visit& visit) const;
  std::vector<uint32_t> CountTriangles(const LevelMesh& mesh, double margin) const;
  void SplitCell(const std::vector<uint32_t>& counts, uint32_t parent, uint32_t depth,
                 std::array<uint32_t, 3> at, Level* level) const;
  void FillParts(Level* level) const;
  bool IsSound(const Level& level) const;
  void RestoreParts(Level* level) const;

  // Where the last triangle was alone in a tile: most are near the one before.
  struct LastTile {
    Box3d cell;  // less the margin
    uint32_t tile = 0;
  };

  Box3d cube_;
  mutable LastTile last_;
  bool quad_;
  uint64_t most_triangles_;
  std::vector<Level> levels_;
};

}  // namespace mtdb
