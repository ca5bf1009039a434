// SPDX-License-Identifier: Apache-2.0
#include "tools/render/internal/decode_image.h"

#include <csetjmp>
#include <cstdio>
#include <jerror.h>
#include <jpeglib.h>
#include <png.h>

#include "store/base/out_of_memory.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMostPixels = uint64_t{1} << 27;
// Encoders make about ten of a progressive JPEG. Each takes the time of all pixels, and may be a
// few bytes.
constexpr int kMostScans = 100;

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

// libjpeg's errors come back by a jump, over frames without destructors.
struct JpegErrors {
  jpeg_error_mgr manager;
  std::jmp_buf back;
  char text[JMSG_LENGTH_MAX];
  bool damaged;
};

JpegErrors* ErrorsOf(j_common_ptr jpeg) { return reinterpret_cast<JpegErrors*>(jpeg->err); }

[[noreturn]] void JumpBack(j_common_ptr jpeg) {
  jpeg->err->format_message(jpeg, ErrorsOf(jpeg)->text);
  std::longjmp(ErrorsOf(jpeg)->back, 1);
}

// libjpeg goes on after damage with grey for what is missing; that is no image of the ground.
void Note(j_common_ptr jpeg, int level) {
  if (level >= 0) return;
  jpeg->err->format_message(jpeg, ErrorsOf(jpeg)->text);
  ErrorsOf(jpeg)->damaged = true;
}

void NoMessage(j_common_ptr) {}

void RefuseManyScans(j_common_ptr jpeg) {
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number <= kMostScans) return;
  std::snprintf(ErrorsOf(jpeg)->text, sizeof(ErrorsOf(jpeg)->text), "it has more than %d scans",
                kMostScans);
  std::longjmp(ErrorsOf(jpeg)->back, 1);
}

enum class JpegStep : uint8_t { kHead, kRows };

// All that may jump. Returns false with the reason in `errors`.
bool RunJpeg(JpegStep step, jpeg_decompress_struct* jpeg, JpegErrors* errors, uint8_t* rgba) {
  if (setjmp(errors->back) != 0) return false;
  if (step == JpegStep::kHead) {
    jpeg_read_header(jpeg, TRUE);
    jpeg->out_color_space = JCS_EXT_RGBA;
    return true;
  }
  jpeg_start_decompress(jpeg);
  while (jpeg->output_scanline < jpeg->output_height && !errors->damaged) {
    JSAMPROW row = rgba + size_t{4} * jpeg->output_width * jpeg->output_scanline;
    jpeg_read_scanlines(jpeg, &row, 1);
  }
  if (!errors->damaged) jpeg_finish_decompress(jpeg);
  return !errors->damaged;
}

struct JpegReader {
  jpeg_decompress_struct jpeg{};
  JpegErrors errors{};
  jpeg_progress_mgr progress{};
  explicit JpegReader(const std::string& file) {
    jpeg.err = jpeg_std_error(&errors.manager);
    errors.manager.error_exit = JumpBack;
    errors.manager.emit_message = Note;
    errors.manager.output_message = NoMessage;
    jpeg_create_decompress(&jpeg);
    progress.progress_monitor = RefuseManyScans;
    jpeg.progress = &progress;
    jpeg_mem_src(&jpeg, reinterpret_cast<const uint8_t*>(file.data()), file.size());
  }
  ~JpegReader() { jpeg_destroy_decompress(&jpeg); }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;

  bool Run(JpegStep step, uint8_t* rgba) { return RunJpeg(step, &jpeg, &errors, rgba); }
};

Result<Pixels> DecodeJpeg(const std::string& file) {
  JpegReader reader(file);
  if (!reader.Run(JpegStep::kHead, nullptr)) {
    return BadInput(std::string("the JPEG file cannot be read: ") + reader.errors.text);
  }
  if (reader.jpeg.num_components == 4) {
    return Unsupported("the JPEG file is in CMYK; convert it to RGB");
  }
  Pixels pixels;
  MTDB_RETURN_IF_ERROR(MakeRoom(reader.jpeg.image_width, reader.jpeg.image_height, &pixels));
  if (!reader.Run(JpegStep::kRows, pixels.rgba.data())) {
    if (reader.errors.manager.msg_code == JERR_OUT_OF_MEMORY) return OutOfMemory();
    return BadInput(std::string("the JPEG file is damaged: ") + reader.errors.text);
  }
  return pixels;
}

}  // namespace

Result<Pixels> DecodeImage(const std::string& file) {
  if (file.starts_with("\x89PNG")) return DecodePng(file);
  if (file.starts_with("\xff\xd8")) return DecodeJpeg(file);
  return BadInput("the image is neither a PNG nor a JPEG file");
}

}  // namespace mtdb::internal
