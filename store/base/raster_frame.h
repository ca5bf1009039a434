// SPDX-License-Identifier: Apache-2.0
// RasterFrame: where the samples of a raster of heights lie, as its file says it.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "store/base/grid.h"

namespace mtdb {

// The georeference of an object that was a raster (PositionMode::kRaster). The strings are as they
// came, and empty where the file says nothing; the CRS is ObjectRecord::georeference.
struct RasterFrame {
  uint32_t columns = 0, rows = 0;  // of the whole raster, holes included; at least 1
  // x = g[0] + g[1] * column + g[2] * row; y = g[3] + g[4] * column + g[5] * row.
  std::array<double, 6> geotransform{0, 1, 0, 0, 0, -1};
  // What the transform gives: a sample itself, or the corner of its pixel, so that the sample lies
  // at column + 1/2, row + 1/2.
  bool transform_of_samples = false;
  bool is_area = true;           // AREA_OR_POINT: a sample stands for its pixel, or for a point
  std::optional<double> nodata;  // the height that stood for a hole; NaN is none
  std::string sample_type;       // "int16", "float32"
  std::string height_units;      // "m"
  std::string vertical_datum;
  uint64_t filled = 0;  // samples that had no height, and that ingest gave one

  // True when the raster's first row is its last in the store, as where y falls from row to row:
  // stored triangles run counter-clockwise seen from above.
  bool is_flipped() const;
  // The row of a lattice's second number, and the other way round.
  uint32_t Row(int32_t j) const {
    return is_flipped() ? rows - 1 - static_cast<uint32_t>(j) : static_cast<uint32_t>(j);
  }
  int32_t LatticeRow(uint32_t row) const {
    return static_cast<int32_t>(is_flipped() ? rows - 1 - row : row);
  }

  friend bool operator==(const RasterFrame&, const RasterFrame&) = default;
};

// The grid of the frame's lattice, whose points are (column, LatticeRow(row), steps of height).
Grid GridOf(const RasterFrame& frame, double height_step, double height_origin);

}  // namespace mtdb
