// SPDX-License-Identifier: Apache-2.0
// OpenGdalRaster: every raster that GDAL reads, for programs that ingest.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "codecs/raster_file/raster_file.h"

namespace mtdb {

// Whether GDAL was there when this program was built.
bool HasGdal();
// Opens band 1 of a file that GDAL knows; GDAL's cache of blocks takes at most `cache_bytes`.
// kUnsupported when GDAL does not know it, or the file is not placed by an affine transform, or
// this program has no GDAL. Others: kNotFound, kIoError, kBadInput.
Result<std::unique_ptr<RasterReader>> OpenGdalRaster(const std::string& path, uint64_t cache_bytes);

}  // namespace mtdb
