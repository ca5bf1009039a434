// SPDX-License-Identifier: Apache-2.0
#include <cstring>
#include <png.h>

#include "codecs/mesh_file/atomic_file.h"
#include "store/base/check.h"
#include "tools/render/render.h"

namespace mtdb {

namespace {

// Four bytes a pixel; empty when the image is opaque.
std::vector<uint8_t> WithAlpha(const RenderImage& image) {
  std::vector<uint8_t> rgba(4 * image.alpha.size());
  for (size_t i = 0; i < image.alpha.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) rgba[4 * i + c] = image.rgb[3 * i + c];
    rgba[4 * i + 3] = image.alpha[i];
  }
  return rgba;
}

}  // namespace

Status WritePng(const std::string& path, const RenderImage& image) {
  MTDB_CHECK(image.width > 0 && image.height > 0 &&
                 image.rgb.size() == size_t{3} * static_cast<size_t>(image.width) *
                                         static_cast<size_t>(image.height),
             "an image has three bytes a pixel");
  const std::vector<uint8_t> rgba = WithAlpha(image);
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = rgba.empty() ? PNG_FORMAT_RGB : PNG_FORMAT_RGBA;
  Bytes bytes(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = bytes.size();
  const uint8_t* const pixels = rgba.empty() ? image.rgb.data() : rgba.data();
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, pixels, 0, nullptr) == 0) {
    const std::string why = png.message;
    png_image_free(&png);
    return IoError(path + ": the picture cannot be coded: " + why);
  }
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  MTDB_RETURN_IF_ERROR(file->Append(ByteSpan(bytes).first(size)));
  return file->Commit();
}

}  // namespace mtdb
