// SPDX-License-Identifier: Apache-2.0
// Greedy insertion, the peer of terrains (Garland and Heckbert, 1995).
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mtdb {

// Heights of samples, row by row.
struct Heights {
  uint32_t columns = 0, rows = 0;
  std::vector<double> at;
  double height(int64_t column, int64_t row) const {
    return at[static_cast<size_t>(row * columns + column)];
  }
};

// Triangles of a Delaunay triangulation of samples, over CGAL: begins with the corners, and inserts
// the sample that is farthest from the surface until none is farther than `error`. At least 2 x 2
// samples, all with heights.
uint64_t TrianglesOfGreedyInsertion(const Heights& heights, double error);

}  // namespace mtdb
