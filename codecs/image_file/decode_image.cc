// SPDX-License-Identifier: Apache-2.0
#include "codecs/image_file/decode_image.h"

#include <memory>
#include <png.h>

#include "codecs/image_file/jpeg_reader.h"

namespace mtdb {

namespace {

constexpr uint64_t kMostPixels = uint64_t{1} << 27;

ByteSpan AsBytes(const std::string& file) {
  return {reinterpret_cast<const std::byte*>(file.data()), file.size()};
}

Status MakeRoom(uint64_t width, uint64_t height, Pixels* pixels) {
  if (width * height > kMostPixels) {
    return Unsupported("the image has " + std::to_string(width) + " x " + std::to_string(height) +
                       " pixels; at most " + std::to_string(kMostPixels) +
                       " are drawn: make it smaller, as gdal_translate -outsize does");
  }
  pixels->width = width;
  pixels->height = height;
  pixels->rgba.resize(4 * pixels->width * pixels->height);
  return Status::Ok();
}

Result<Pixels> DecodePng(const std::string& file) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  const auto bad = [&](const char* what) {
    const std::string why = png.message;
    png_image_free(&png);
    return BadInput(std::string(what) + why);
  };
  if (png_image_begin_read_from_memory(&png, file.data(), file.size()) == 0) {
    return bad("the PNG file cannot be read: ");
  }
  png.format = PNG_FORMAT_RGBA;
  // 16 bits without a word on their gamma mean what 8 bits do, not linear light.
  png.flags |= PNG_IMAGE_FLAG_16BIT_sRGB;
  Pixels pixels;
  const Status room = MakeRoom(png.width, png.height, &pixels);
  if (!room.ok()) {
    png_image_free(&png);
    return room;
  }
  if (png_image_finish_read(&png, nullptr, pixels.rgba.data(), 0, nullptr) == 0) {
    return bad("the PNG file is damaged: ");
  }
  return pixels;
}

Result<Pixels> DecodeJpeg(const std::string& file) {
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<internal::JpegReader> reader,
                        internal::JpegReader::Open(AsBytes(file)));
  Pixels pixels;
  MTDB_RETURN_IF_ERROR(MakeRoom(reader->width(), reader->height(), &pixels));
  for (size_t y = 0; y < pixels.height; ++y) {
    MTDB_RETURN_IF_ERROR(reader->ReadRow(true, &pixels.rgba[4 * pixels.width * y]));
  }
  return pixels;
}

}  // namespace

Result<Pixels> DecodeImage(const std::string& file) {
  if (file.starts_with("\x89PNG")) return DecodePng(file);
  if (file.starts_with("\xff\xd8")) return DecodeJpeg(file);
  return BadInput("the image is neither a PNG nor a JPEG file");
}

}  // namespace mtdb
