// SPDX-License-Identifier: Apache-2.0
// The closed surface of the shape "sheets": a torus around z with dents, as a grid of columns
// around the axis and rows around the tube, two triangles a cell.
#pragma once

#include <array>
#include <cstdint>

#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"

namespace mtdb::internal {

// Each function takes constant time and no memory. Columns and rows wrap around.
class SheetsBase {
 public:
  // At least 3 of each.
  SheetsBase(uint64_t columns, uint64_t rows, uint64_t seed)
      : columns_(columns), rows_(rows), seed_(seed) {}
  uint64_t columns() const { return columns_; }
  uint64_t rows() const { return rows_; }
  uint64_t vertex_count() const { return columns_ * rows_; }

  uint64_t VertexAt(uint64_t column, uint64_t row) const {
    return row % rows_ * columns_ + column % columns_;
  }
  Vec3d PositionAt(uint64_t column, uint64_t row) const;
  Vec3d NormalAt(uint64_t column, uint64_t row) const;  // outward, of length 1
  // The cell's two triangles, the one below the diagonal first, counter-clockwise from outside. All
  // diagonals lead from (column, row) to (column + 1, row + 1).
  std::array<TriangleVertices, 2> CellAt(uint64_t column, uint64_t row) const;
  // Whether each of them has an opposite copy. They do in ten patches with a third of the area. A
  // patch is a parallelogram of the grid that has lost the two corners at which the diagonals
  // allow it; since the grid is bent smoothly, so are the patches' borders, but for six corners.
  std::array<bool, 2> TwoSidedAt(uint64_t column, uint64_t row) const;

 private:
  uint64_t columns_, rows_, seed_;
};

}  // namespace mtdb::internal
