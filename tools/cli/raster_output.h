// SPDX-License-Identifier: Apache-2.0
// RasterOutput: a terrain as a raster again, in a file.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "query/heights.h"
#include "store/object_record.h"

namespace mtdb {

// Whether the path names a raster that can be written: .asc, .hgt, and .tif with GDAL.
bool IsRasterOutput(const std::string& path);

struct RasterOutputOptions {
  std::optional<std::array<double, 2>> spacing;  // of samples in x and y; none: the raster's own
  std::optional<std::array<double, 4>> window;   // least x and y, largest x and y; none: all
  HeightOptions heights;
};
struct RasterOutputReport {
  uint32_t columns = 0, rows = 0;
  uint64_t holes = 0;
  HeightCost cost;
  double rounding = 0;  // how far a height was moved to fit the file's type, at most
};

// Writes the heights of `surface`, a terrain, to `path`, band after band. With the raster's own
// spacing samples are those of the raster, and at full resolution they have its heights and type
// (float64 where that cannot hold them); else heights are float32 (.tif) or decimals (.asc). Holes
// have the raster's nodata value, or another one where heights lie around that. .hgt is for one
// tile of whole degrees. The file appears when it is whole. Errors: kInvalidArgument (no terrain; a
// window without samples; what .hgt cannot hold), kUnsupported, kIoError, kNoSpace, those of
// reading clusters.
Result<RasterOutputReport> WriteRaster(const Surface& surface, const std::string& path,
                                       const RasterOutputOptions& options);

}  // namespace mtdb
