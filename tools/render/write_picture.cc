// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <csetjmp>
#include <cstdio>  // jpeglib.h needs it
#include <cstdlib>
#include <cstring>
#include <jpeglib.h>
#include <memory>
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

namespace {

struct JpegErrors {
  jpeg_error_mgr manager;
  std::jmp_buf leave;
};

// Nothing with a destructor may live in a frame that libjpeg's errors leave. False: it failed.
bool CodeJpeg(const RenderImage& image, jpeg_compress_struct* jpeg, JpegErrors* errors,
              unsigned char** bytes, unsigned long* size) {
  if (setjmp(errors->leave) != 0) return false;
  jpeg_create_compress(jpeg);
  jpeg_mem_dest(jpeg, bytes, size);
  jpeg->image_width = static_cast<JDIMENSION>(image.width);
  jpeg->image_height = static_cast<JDIMENSION>(image.height);
  jpeg->input_components = 3;
  jpeg->in_color_space = JCS_RGB;
  jpeg_set_defaults(jpeg);
  constexpr int kQuality = 92;
  jpeg_set_quality(jpeg, kQuality, TRUE);
  jpeg_start_compress(jpeg, TRUE);
  while (jpeg->next_scanline < jpeg->image_height) {
    const auto row = size_t{3} * jpeg->image_width * jpeg->next_scanline;
    JSAMPROW line = const_cast<JSAMPROW>(image.rgb.data() + row);
    jpeg_write_scanlines(jpeg, &line, 1);
  }
  jpeg_finish_compress(jpeg);
  return true;
}

bool EndsAs(const std::string& path, const std::string& suffix) {
  if (path.size() <= suffix.size()) return false;
  std::string end = path.substr(path.size() - suffix.size());
  for (char& c : end) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return end == suffix;
}

}  // namespace

Status WriteJpeg(const std::string& path, const RenderImage& image) {
  if (!image.alpha.empty()) {
    return InvalidArgument(path + ": JPEG has no transparency; write .png, or draw a background");
  }
  jpeg_compress_struct jpeg{};
  JpegErrors errors{};
  jpeg.err = jpeg_std_error(&errors.manager);
  errors.manager.error_exit = [](j_common_ptr common) {
    std::longjmp(reinterpret_cast<JpegErrors*>(common->err)->leave, 1);
  };
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  const bool coded = CodeJpeg(image, &jpeg, &errors, &bytes, &size);
  const std::unique_ptr<unsigned char, void (*)(void*)> owner(bytes, std::free);
  jpeg_destroy_compress(&jpeg);
  if (!coded) return IoError(path + ": the picture cannot be coded as JPEG");
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<AtomicFile> file, AtomicFile::Create(path));
  MTDB_RETURN_IF_ERROR(
      file->Append(ByteSpan(reinterpret_cast<const std::byte*>(bytes), size_t{size})));
  return file->Commit();
}

Status CheckPictureName(const std::string& path) {
  if (EndsAs(path, ".png") || EndsAs(path, ".jpg") || EndsAs(path, ".jpeg")) return Status::Ok();
  return InvalidArgument(path + ": expected a name that ends in .png, .jpg or .jpeg");
}

Status WritePicture(const std::string& path, const RenderImage& image) {
  return EndsAs(path, ".png") ? WritePng(path, image) : WriteJpeg(path, image);
}

}  // namespace mtdb
