// SPDX-License-Identifier: Apache-2.0
#include "codecs/image_file/decode_image.h"

#include <memory>

#include "codecs/image_file/image_rows.h"

namespace mtdb {

namespace {

constexpr uint64_t kMostPixels = uint64_t{1} << 27;

}  // namespace

Result<Pixels> DecodeImage(ByteSpan file) {
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ImageRows> rows,
                        ImageRows::Open(file, 6 * kMostPixels));
  Pixels pixels;
  pixels.width = rows->width();
  pixels.height = rows->height();
  if (pixels.width * pixels.height > kMostPixels) {
    return Unsupported("the image has " + std::to_string(pixels.width) + " x " +
                       std::to_string(pixels.height) + " pixels; at most " +
                       std::to_string(kMostPixels) +
                       " are drawn: make it smaller, as gdal_translate -outsize does");
  }
  const size_t channels = rows->channels();
  std::vector<uint8_t> row(channels * pixels.width);
  pixels.rgba.reserve(4 * pixels.width * pixels.height);
  for (size_t y = 0; y < pixels.height; ++y) {
    MTDB_RETURN_IF_ERROR(rows->ReadRow(row.data()));
    for (size_t x = 0; x < row.size(); x += channels) {
      pixels.rgba.insert(pixels.rgba.end(), {row[x], row[x + 1], row[x + 2],
                                             channels == 4 ? row[x + 3] : uint8_t{255}});
    }
  }
  return pixels;
}

}  // namespace mtdb
