// SPDX-License-Identifier: Apache-2.0
// ReadGdalImage: an image and its place, by GDAL.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "store/base/status.h"

namespace mtdb {

// A picture of the ground.
struct PlacedImage {
  std::string mime_type;  // "image/png" or "image/jpeg"
  std::string bytes;      // of a file
  // x = g[0] + g[1] * column + g[2] * row, y = g[3] + g[4] * column + g[5] * row, of the corners of
  // the pixels of an image of `columns` and `rows`.
  std::array<double, 6> geotransform{};
  uint32_t columns = 0, rows = 0;
  std::string crs;  // WKT2; empty: not known
};

// As PNG, of at most 8192 columns and rows. kUnsupported when GDAL does not know it, it has no
// place, or this program has no GDAL. Others: kNotFound, kBadInput.
Result<PlacedImage> ReadGdalImage(const std::string& path);

}  // namespace mtdb
