// SPDX-License-Identifier: Apache-2.0
// GdalWriter: a raster of heights into a GeoTIFF, by GDAL.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "store/base/status.h"

namespace mtdb {

struct GdalRaster {
  uint32_t columns = 0, rows = 0;
  std::array<double, 6> geotransform{0, 1, 0, 0, 0, -1};  // of the corners of pixels
  bool is_area = true;
  std::string sample_type;  // as RasterFrame::sample_type; others: float64
  std::string height_units;
  std::string crs;               // WKT; empty: none
  std::optional<double> nodata;  // none: no height is a hole
};

// Takes rows from the first to the last. The file has its name when End() has succeeded.
class GdalWriter {
 public:
  virtual ~GdalWriter() = default;
  virtual Status Add(std::span<const double> heights) = 0;  // NaN: a hole
  virtual Status End() = 0;
};

// Deflate with a predictor, in tiles. kUnsupported when this program has no GDAL; kIoError.
Result<std::unique_ptr<GdalWriter>> CreateGeoTiff(const std::string& path,
                                                  const GdalRaster& raster);

}  // namespace mtdb
