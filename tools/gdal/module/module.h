// SPDX-License-Identifier: Apache-2.0
// What the module has: a library of its own that links GDAL, which is loaded when it is needed.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "codecs/raster_file/raster_file.h"
#include "tools/gdal/gdal_image.h"
#include "tools/gdal/gdal_writer.h"

namespace mtdb {

Result<std::unique_ptr<RasterReader>> OpenByGdal(const std::string& path, uint64_t cache_bytes);
Result<std::unique_ptr<GdalWriter>> CreateByGdal(const std::string& path, const GdalRaster& raster);

Result<PlacedImage> ReadImageByGdal(const std::string& path);

struct GdalEntries {
  decltype(&OpenByGdal) open;
  decltype(&CreateByGdal) create;
  decltype(&ReadImageByGdal) read_image;
};
// The module's only symbol: the program and the module are of one build.
inline constexpr char kGdalEntries[] = "mtdb_gdal_entries";

}  // namespace mtdb
