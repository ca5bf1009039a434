// SPDX-License-Identifier: Apache-2.0
// RasterReader: a file of heights on a regular grid, read row by row.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "store/base/raster_frame.h"
#include "store/base/status.h"

namespace mtdb {

// What a file says of itself.
struct RasterInfo {
  std::string format;  // "SRTM .hgt"
  RasterFrame frame;
  std::string crs;  // WKT2, or as it came; empty: the file does not say
  // All heights are multiples of it, as they are written: 1 for integers, 0.01 for two decimals. 0:
  // not known.
  double height_step = 0;
  double height_origin = 0;        // heights are multiples of the step from here
  std::vector<std::string> notes;  // sentences about how the file was understood, with its path
};

// A raster that is open. Single thread. Memory does not grow with the number of rows, but for
// eight bytes a row of text formats.
class RasterReader {
 public:
  virtual ~RasterReader() = default;
  const std::string& path() const { return path_; }
  const RasterInfo& info() const { return info_; }
  // The heights of a row, info().frame.columns of them; NaN: there is none. Rows in any order;
  // upwards is fast. Errors: kIoError, and kBadInput with file and place.
  virtual Status ReadRow(uint32_t row, std::span<double> heights) = 0;

 protected:
  std::string path_;
  RasterInfo info_;
};

// Opens a file of the formats that mtdb reads by itself: SRTM .hgt, ESRI ASCII grid, USGS DEM.
// kUnsupported when it is none of them. Others: kNotFound, kIoError, kBadInput.
Result<std::unique_ptr<RasterReader>> OpenOwnRaster(const std::string& path);
// The suffixes of these formats: ".hgt .asc .dem".
std::string OwnRasterSuffixes();

}  // namespace mtdb
