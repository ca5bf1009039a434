// SPDX-License-Identifier: Apache-2.0
// An image and its place, to be draped over an object.
#pragma once

#include <string>

#include "codecs/mesh_file/draped_mesh_file.h"
#include "store/object_record.h"
#include "tools/gdal/gdal_image.h"

namespace mtdb {

// PNG and JPEG with a world file beside them (.pgw, .jgw, .wld; six numbers), as they are; else
// what GDAL reads. kNotFound, kBadInput, kUnsupported.
Result<PlacedImage> ReadPlacedImage(const std::string& path);

// The same for an object. Errors: kInvalidArgument when the image lies elsewhere than the object,
// or their coordinate systems are of different kinds; those of ReadPlacedImage.
Result<MeshTexture> ReadDrape(const std::string& path, const ObjectRecord& record);

}  // namespace mtdb
