// SPDX-License-Identifier: Apache-2.0
// Texture coordinates of triangles' corners, and the images that they point into.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "store/base/attributes.h"
#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Where a corner of a triangle lies in an image. u goes to the right and v up, from 0 to 1 across
// the image, as in OBJ; values beyond repeat it. The corners of a triangle are on one page.
struct TextureCorner {
  float u = 0, v = 0;
  uint32_t page = 0;  // of MeshHeader::textures; kNoPage: the triangle has no image
  static constexpr uint32_t kNoPage = 0xffffffff;
  friend bool operator==(const TextureCorner&, const TextureCorner&) = default;
};
// Rows of corners are such structs.
static_assert(sizeof(TextureCorner) == 12);

// More pages than this are refused.
inline constexpr uint32_t kMostPages = 65536;

// A page: an image file.
struct Texture {
  std::string name;        // of the file, without its folder; unique in a mesh
  std::string media_type;  // "image/jpeg", "image/png", "image/webp", "image/tiff"; or empty
  uint32_t width = 0, height = 0;  // pixels; 0: not known
  // The file's bytes; one that fails says why there are none. Empty: nobody has them.
  std::function<Result<Bytes>()> load;
};

// How a codec sees corners: `step` as that of VertexAttribute, for u and v.
inline AttributeLayout CornerLayout(double step) {
  return {{{"texture_u", ScalarType::kFloat32, step},
           {"texture_v", ScalarType::kFloat32, step},
           {"texture_page", ScalarType::kUint32}}};
}

}  // namespace mtdb
