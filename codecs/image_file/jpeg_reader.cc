// SPDX-License-Identifier: Apache-2.0
#include "codecs/image_file/jpeg_reader.h"

#include <algorithm>
#include <csetjmp>
#include <cstdio>  // jpeglib.h needs it
#include <jerror.h>
#include <jpeglib.h>
#include <string>
#include <utility>

#include "store/base/out_of_memory.h"

namespace mtdb::internal {

namespace {

// Encoders make about ten of a progressive JPEG. Each takes the time of all pixels, and may be a
// few bytes.
constexpr int kMostScans = 100;

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

// All that may jump. Returns false with the reason in `errors`.
bool ReadHead(jpeg_decompress_struct* jpeg, JpegErrors* errors) {
  if (setjmp(errors->back) != 0) return false;
  jpeg_read_header(jpeg, TRUE);
  return true;
}

bool Begin(jpeg_decompress_struct* jpeg, JpegErrors* errors) {
  if (setjmp(errors->back) != 0) return false;
  jpeg_start_decompress(jpeg);
  return !errors->damaged;
}

bool ReadOne(jpeg_decompress_struct* jpeg, JpegErrors* errors, uint8_t* row) {
  if (setjmp(errors->back) != 0) return false;
  JSAMPROW line = row;
  jpeg_read_scanlines(jpeg, &line, 1);
  if (jpeg->output_scanline == jpeg->output_height && !errors->damaged) {
    jpeg_finish_decompress(jpeg);
  }
  return !errors->damaged;
}

}  // namespace

struct JpegReader::State {
  jpeg_decompress_struct jpeg{};
  JpegErrors errors{};
  jpeg_progress_mgr progress{};
  bool begun = false;

  explicit State(ByteSpan file) {
    jpeg.err = jpeg_std_error(&errors.manager);
    errors.manager.error_exit = JumpBack;
    errors.manager.emit_message = Note;
    errors.manager.output_message = NoMessage;
    jpeg_create_decompress(&jpeg);
    progress.progress_monitor = RefuseManyScans;
    jpeg.progress = &progress;
    jpeg_mem_src(&jpeg, reinterpret_cast<const uint8_t*>(file.data()), file.size());
  }
  ~State() { jpeg_destroy_decompress(&jpeg); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
};

JpegReader::JpegReader(std::unique_ptr<State> state) : state_(std::move(state)) {}

JpegReader::~JpegReader() = default;

Result<std::unique_ptr<JpegReader>> JpegReader::Open(ByteSpan file) {
  auto state = std::make_unique<State>(file);
  if (!ReadHead(&state->jpeg, &state->errors)) {
    return BadInput(std::string("the JPEG file cannot be read: ") + state->errors.text);
  }
  if (state->jpeg.num_components == 4) {
    return Unsupported("the JPEG file is in CMYK; convert it to RGB");
  }
  return std::unique_ptr<JpegReader>(new JpegReader(std::move(state)));
}

uint32_t JpegReader::width() const { return state_->jpeg.image_width; }
uint32_t JpegReader::height() const { return state_->jpeg.image_height; }
uint64_t JpegReader::bytes_at_once() const {
  jpeg_decompress_struct& jpeg = state_->jpeg;
  if (jpeg_has_multiple_scans(&jpeg) == FALSE) return 0;
  int h = 1, v = 1;
  for (int c = 0; c < jpeg.num_components; ++c) {
    h = std::max(h, jpeg.comp_info[c].h_samp_factor);
    v = std::max(v, jpeg.comp_info[c].v_samp_factor);
  }
  uint64_t bytes = 0;  // two a coefficient
  for (int c = 0; c < jpeg.num_components; ++c) {
    const auto part = static_cast<uint64_t>(jpeg.comp_info[c].h_samp_factor) *
                      static_cast<uint64_t>(jpeg.comp_info[c].v_samp_factor);
    bytes += 2 * uint64_t{width()} * height() * part / static_cast<uint64_t>(h * v);
  }
  return bytes;
}

Status JpegReader::ReadRow(uint8_t* row) {
  State& s = *state_;
  bool ok = true;
  if (!std::exchange(s.begun, true)) {
    s.jpeg.out_color_space = JCS_RGB;
    ok = Begin(&s.jpeg, &s.errors);
  }
  if (ok) ok = ReadOne(&s.jpeg, &s.errors, row);
  if (ok) return Status::Ok();
  if (s.errors.manager.msg_code == JERR_OUT_OF_MEMORY) return OutOfMemory();
  return BadInput(std::string("the JPEG file is damaged: ") + s.errors.text);
}

}  // namespace mtdb::internal
