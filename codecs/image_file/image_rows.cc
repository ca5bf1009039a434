// SPDX-License-Identifier: Apache-2.0
#include "codecs/image_file/image_rows.h"

#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <png.h>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "codecs/image_file/jpeg_reader.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

namespace {

constexpr uint32_t kMostSide = 65536;
constexpr uint64_t kMostPixels = uint64_t{1} << 30;

// `at_once`: bytes that are in memory together; 0 of an image in rows.
Status CheckSize(uint64_t width, uint64_t height, uint64_t at_once, uint64_t most_at_once) {
  const std::string size = std::to_string(width) + " x " + std::to_string(height) + " pixels";
  if (width > kMostSide || height > kMostSide || width * height > kMostPixels) {
    return Unsupported("the image has " + size + "; at most " + std::to_string(kMostSide) +
                       " on a side, and " + std::to_string(kMostPixels) + " in all, are read");
  }
  if (at_once > most_at_once) {
    return Unsupported("the image has " + size + " and is interlaced or progressive, so that " +
                       std::to_string(at_once >> 20) + " MiB would be in memory at once; at most " +
                       std::to_string(most_at_once >> 20) + " are: write it without that");
  }
  return Status::Ok();
}

class JpegRows final : public ImageRows {
 public:
  static Result<std::unique_ptr<ImageRows>> Open(ByteSpan file, uint64_t most_at_once) {
    MTDB_ASSIGN_OR_RETURN(std::unique_ptr<internal::JpegReader> reader,
                          internal::JpegReader::Open(file));
    MTDB_RETURN_IF_ERROR(
        CheckSize(reader->width(), reader->height(), reader->bytes_at_once(), most_at_once));
    return std::unique_ptr<ImageRows>(new JpegRows(std::move(reader)));
  }
  Status ReadRow(uint8_t* row) override { return reader_->ReadRow(row); }

 private:
  explicit JpegRows(std::unique_ptr<internal::JpegReader> reader) : reader_(std::move(reader)) {
    width_ = reader_->width();
    height_ = reader_->height();
  }
  const std::unique_ptr<internal::JpegReader> reader_;
};

// libpng's errors come back by a jump, over frames without destructors.
struct PngState {
  ByteSpan file;
  size_t at = 0;
  png_structp png = nullptr;
  png_infop info = nullptr;
  std::jmp_buf back;
  char text[256] = "";

  PngState() = default;
  ~PngState() { png_destroy_read_struct(&png, &info, nullptr); }
  PngState(const PngState&) = delete;
  PngState& operator=(const PngState&) = delete;
};

[[noreturn]] void OnError(png_structp png, png_const_charp why) {
  auto* const state = static_cast<PngState*>(png_get_error_ptr(png));
  std::snprintf(state->text, sizeof(state->text), "%s", why);
  std::longjmp(state->back, 1);
}

void OnWarning(png_structp, png_const_charp) {}

void ReadBytes(png_structp png, png_bytep to, size_t bytes) {
  auto* const state = static_cast<PngState*>(png_get_io_ptr(png));
  if (bytes > state->file.size() - state->at) png_error(png, "the file ends too early");
  std::memcpy(to, state->file.data() + state->at, bytes);
  state->at += bytes;
}

// Until the rows: what they have is made 8 bits a channel, 3 or 4 channels.
bool ReadPngHead(PngState* state) {
  if (setjmp(state->back) != 0) return false;
  png_set_read_fn(state->png, state, ReadBytes);
  png_read_info(state->png, state->info);
  png_set_expand(state->png);
  png_set_scale_16(state->png);
  png_set_gray_to_rgb(state->png);
  png_set_interlace_handling(state->png);
  png_read_update_info(state->png, state->info);
  return true;
}

bool ReadPngRow(PngState* state, png_bytep row) {
  if (setjmp(state->back) != 0) return false;
  png_read_row(state->png, row, nullptr);
  return true;
}

bool ReadPngImage(PngState* state, png_bytepp rows) {
  if (setjmp(state->back) != 0) return false;
  png_read_image(state->png, rows);
  return true;
}

class PngRows final : public ImageRows {
 public:
  static Result<std::unique_ptr<ImageRows>> Open(ByteSpan file, uint64_t most_at_once) {
    std::unique_ptr<PngRows> rows(new PngRows);
    PngState& s = rows->state_;
    s.file = file;
    s.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &s, OnError, OnWarning);
    s.info = s.png == nullptr ? nullptr : png_create_info_struct(s.png);
    if (s.info == nullptr) return OutOfMemory();
    if (!ReadPngHead(&s)) {
      return BadInput(std::string("the PNG file cannot be read: ") + s.text);
    }
    rows->width_ = png_get_image_width(s.png, s.info);
    rows->height_ = png_get_image_height(s.png, s.info);
    rows->channels_ = png_get_channels(s.png, s.info);
    rows->interlaced_ = png_get_interlace_type(s.png, s.info) != PNG_INTERLACE_NONE;
    const uint64_t pixels = uint64_t{rows->width_} * rows->height_;
    MTDB_RETURN_IF_ERROR(CheckSize(rows->width_, rows->height_,
                                   rows->interlaced_ ? pixels * rows->channels_ : 0, most_at_once));
    if (rows->channels_ != 3 && rows->channels_ != 4) {
      return BadInput("the PNG file cannot be read: it has " + std::to_string(rows->channels_) +
                      " channels");
    }
    return std::unique_ptr<ImageRows>(std::move(rows));
  }

  Status ReadRow(uint8_t* row) override {
    const size_t bytes = size_t{width_} * channels_;
    if (!interlaced_) return Checked(ReadPngRow(&state_, row));
    if (all_.empty()) {
      all_.resize(bytes * height_);
      std::vector<png_bytep> rows(height_);
      for (size_t y = 0; y < height_; ++y) rows[y] = &all_[bytes * y];
      MTDB_RETURN_IF_ERROR(Checked(ReadPngImage(&state_, rows.data())));
    }
    std::memcpy(row, &all_[bytes * next_++], bytes);
    return Status::Ok();
  }

 private:
  PngRows() = default;
  Status Checked(bool ok) const {
    if (ok) return Status::Ok();
    return BadInput(std::string("the PNG file is damaged: ") + state_.text);
  }

  PngState state_;
  bool interlaced_ = false;
  std::vector<uint8_t> all_;  // of an interlaced image
  size_t next_ = 0;
};

}  // namespace

Result<std::unique_ptr<ImageRows>> ImageRows::Open(ByteSpan file, uint64_t most_at_once) {
  const auto begins = [&](std::string_view with) {
    return file.size() >= with.size() && std::memcmp(file.data(), with.data(), with.size()) == 0;
  };
  return CatchOutOfMemory([&]() -> Result<std::unique_ptr<ImageRows>> {
    if (begins("\x89PNG")) return PngRows::Open(file, most_at_once);
    if (begins("\xff\xd8")) return JpegRows::Open(file, most_at_once);
    return BadInput("the image is neither a PNG nor a JPEG file");
  });
}

}  // namespace mtdb
