// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/terrain_rgb/height_image.h"

#include <png.h>

namespace mtdb {

namespace {

constexpr size_t kChannels = 3;

png_image ImageOf(uint32_t side) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = side;
  png.height = side;
  png.format = PNG_FORMAT_RGB;
  return png;
}

}  // namespace

Result<Bytes> EncodeHeightImage(std::span<const uint32_t> codes, uint32_t side) {
  std::vector<uint8_t> pixels;
  pixels.reserve(kChannels * codes.size());
  for (const uint32_t code : codes) {
    for (const int shift : {16, 8, 0}) pixels.push_back(static_cast<uint8_t>(code >> shift & 255));
  }
  png_image png = ImageOf(side);
  Bytes bytes(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = bytes.size();
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, pixels.data(), 0, nullptr) == 0) {
    const std::string why = png.message;
    png_image_free(&png);
    return Status(StatusCode::kNoSpace, "a tile cannot be written as PNG: " + why);
  }
  bytes.resize(size);
  return bytes;
}

Result<std::vector<uint32_t>> DecodeHeightImage(ByteSpan bytes, uint32_t side) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) == 0) {
    return Corrupt(std::string("is no PNG: ") + png.message);
  }
  if (png.width != side || png.height != side) {
    png_image_free(&png);
    return Corrupt("is not of " + std::to_string(side) + " x " + std::to_string(side) + " pixels");
  }
  png.format = PNG_FORMAT_RGB;
  std::vector<uint8_t> pixels(kChannels * side * side);
  if (png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr) == 0) {
    return Corrupt(std::string("is no whole PNG: ") + png.message);
  }
  std::vector<uint32_t> codes(size_t{side} * side);
  for (size_t i = 0; i < codes.size(); ++i) {
    const uint8_t* const p = pixels.data() + kChannels * i;
    codes[i] = uint32_t{p[0]} << 16 | uint32_t{p[1]} << 8 | p[2];
  }
  return codes;
}

}  // namespace mtdb
