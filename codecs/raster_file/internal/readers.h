// SPDX-License-Identifier: Apache-2.0
// The readers of the formats that need no other library.
#pragma once

#include <memory>
#include <string>

#include "codecs/raster_file/internal/file.h"
#include "codecs/raster_file/raster_file.h"

namespace mtdb::internal {

// Each takes an open file whose name or content says that it is of the format.
Result<std::unique_ptr<RasterReader>> OpenHgt(const std::string& path, RasterInput file);
Result<std::unique_ptr<RasterReader>> OpenAsciiGrid(const std::string& path, RasterInput file);
Result<std::unique_ptr<RasterReader>> OpenUsgsDem(const std::string& path, RasterInput file);

// WKT2 of the systems that these formats imply.
std::string Wgs84Wkt();
// Universal Transverse Mercator, 1..60 north of the equator, -1..-60 south of it. `datum` as USGS
// DEM numbers it: 1 NAD27, 2 WGS 72, 3 WGS 84, 4 NAD83; empty for another one.
std::string UtmWkt(int zone, int datum);

}  // namespace mtdb::internal
