// SPDX-License-Identifier: Apache-2.0
#include "codecs/image_file/encode_image.h"

#include <csetjmp>
#include <cstdio>  // jpeglib.h needs it
#include <cstdlib>
#include <jpeglib.h>
#include <memory>
#include <png.h>
#include <string>

#include "store/base/check.h"

namespace mtdb {

namespace {

struct JpegErrors {
  jpeg_error_mgr manager;
  std::jmp_buf leave;
};

// Nothing with a destructor may live in a frame that libjpeg's errors leave. False: it failed.
bool CodeJpeg(uint32_t width, uint32_t height, const uint8_t* pixels, int quality,
              bool whole_colours, jpeg_compress_struct* jpeg, JpegErrors* errors,
              unsigned char** bytes, unsigned long* size) {
  if (setjmp(errors->leave) != 0) return false;
  jpeg_create_compress(jpeg);
  jpeg_mem_dest(jpeg, bytes, size);
  jpeg->image_width = width;
  jpeg->image_height = height;
  jpeg->input_components = 3;
  jpeg->in_color_space = JCS_RGB;
  jpeg_set_defaults(jpeg);
  jpeg_set_quality(jpeg, quality, TRUE);
  if (whole_colours) jpeg->comp_info[0].h_samp_factor = jpeg->comp_info[0].v_samp_factor = 1;
  jpeg_start_compress(jpeg, TRUE);
  while (jpeg->next_scanline < jpeg->image_height) {
    const auto row = size_t{3} * jpeg->image_width * jpeg->next_scanline;
    JSAMPROW line = const_cast<JSAMPROW>(pixels + row);
    jpeg_write_scanlines(jpeg, &line, 1);
  }
  jpeg_finish_compress(jpeg);
  return true;
}

}  // namespace

Result<Bytes> EncodePng(uint32_t width, uint32_t height, uint32_t channels,
                        std::span<const uint8_t> pixels, bool fast) {
  MTDB_CHECK(width > 0 && height > 0 && (channels == 3 || channels == 4) &&
                 pixels.size() == size_t{width} * height * channels,
             "an image has three or four bytes a pixel");
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = width;
  png.height = height;
  png.format = channels == 3 ? PNG_FORMAT_RGB : PNG_FORMAT_RGBA;
  if (fast) png.flags |= PNG_IMAGE_FLAG_FAST;
  Bytes bytes(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = bytes.size();
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, pixels.data(), 0, nullptr) == 0) {
    const std::string why = png.message;
    png_image_free(&png);
    return IoError("the picture cannot be coded: " + why);
  }
  bytes.resize(size);
  return bytes;
}

Result<Bytes> EncodeJpeg(uint32_t width, uint32_t height, std::span<const uint8_t> pixels,
                         int quality, bool whole_colours) {
  MTDB_CHECK(width > 0 && height > 0 && pixels.size() == size_t{3} * width * height,
             "an image has three bytes a pixel");
  jpeg_compress_struct jpeg{};
  JpegErrors errors{};
  jpeg.err = jpeg_std_error(&errors.manager);
  errors.manager.error_exit = [](j_common_ptr common) {
    std::longjmp(reinterpret_cast<JpegErrors*>(common->err)->leave, 1);
  };
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  const bool coded =
      CodeJpeg(width, height, pixels.data(), quality, whole_colours, &jpeg, &errors, &bytes, &size);
  const std::unique_ptr<unsigned char, void (*)(void*)> owner(bytes, std::free);
  jpeg_destroy_compress(&jpeg);
  if (!coded) return IoError("the picture cannot be coded as JPEG");
  const auto* const begin = reinterpret_cast<const std::byte*>(bytes);
  return Bytes(begin, begin + size);
}

}  // namespace mtdb
