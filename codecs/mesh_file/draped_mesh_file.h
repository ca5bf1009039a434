// SPDX-License-Identifier: Apache-2.0
// CreateDrapedMeshFileWriter: a mesh with an image that is draped over it.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "codecs/mesh_file/mesh_file.h"

namespace mtdb {

// An image and where it lies, seen along z.
struct MeshTexture {
  std::string mime_type;  // "image/png" or "image/jpeg"
  std::string image;      // the bytes of its file
  // At (x, y): u = place[0] + place[1] * x + place[2] * y, from 0 at the image's left side to 1 at
  // its right one; v likewise from place[3] on, from its top to its bottom.
  std::array<double, 6> place{};
};

// As CreateMeshFileWriter, for names that end in .glb: binary glTF with texture coordinates and the
// image, without colours of vertices. Beyond the image's sides its rim goes on. kUnsupported for
// other formats.
Result<std::unique_ptr<MeshFileWriter>> CreateDrapedMeshFileWriter(
    const std::string& path, MeshTexture texture, const MeshWriteOptions& options = {});

}  // namespace mtdb
