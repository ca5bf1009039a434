// SPDX-License-Identifier: Apache-2.0
// HeightGrid: the samples of a tile of Web Mercator, and the heights of triangles at them.
#pragma once

#include <cstdint>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb {

// Samples lie in the middle of pixels, from the north-west corner on. A sample on an edge has the
// same height of both triangles, and none between two triangles is missed: where a row meets an
// edge follows from the edge's two ends alone.
class HeightGrid {
 public:
  // A tile as clients name it, y from the north.
  HeightGrid(uint32_t level, uint32_t x, uint32_t y, uint32_t side);

  // Corners are longitude, latitude and height.
  void Add(const Triangle3d& corners);
  // NaN where no triangle was.
  const std::vector<double>& heights() const { return heights_; }
  double longitude(uint32_t column) const { return longitudes_[column]; }
  double latitude(uint32_t row) const { return latitudes_[row]; }

 private:
  std::vector<double> longitudes_, latitudes_;  // of columns, of rows from the north
  std::vector<double> heights_;
};

}  // namespace mtdb
