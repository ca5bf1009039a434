// SPDX-License-Identifier: Apache-2.0
// An image that lies over a mesh, seen along z.
#pragma once

#include <array>

#include "codecs/mesh_file/draped_mesh_file.h"
#include "store/base/geometry.h"
#include "tools/render/internal/image_levels.h"

namespace mtdb::internal {

// Load first; then safe for many threads. Memory: six bytes a pixel, asked for as if there were
// enough.
class DrapedImage {
 public:
  // Errors: those of DecodeImage.
  Status Load(const MeshTexture& texture);

  // `under`, a linear colour, with the image over it: at (x, y) of the mesh, as seen by an eye to
  // which `size` of the mesh's units is one sample. Beside the image it is `under`.
  Vec3f Over(Vec3f under, double x, double y, double size) const;

 private:
  std::array<double, 6> place_{};
  ImageLevels image_;
};

}  // namespace mtdb::internal
