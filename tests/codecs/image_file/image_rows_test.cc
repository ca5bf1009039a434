// SPDX-License-Identifier: Apache-2.0
// Images come row by row as they come whole, of all kinds of PNG and JPEG; damaged ones are
// refused.
#include "codecs/image_file/image_rows.h"

#include <catch2/catch.hpp>

#include "codecs/image_file/decode_image.h"
#include "codecs/image_file/encode_image.h"
#include "tests/codecs/image_file/image_testing.h"

namespace mtdb::testing {
namespace {

Result<TestImage> ReadRows(const Bytes& file) {
  MTDB_ASSIGN_OR_RETURN(const std::unique_ptr<ImageRows> rows, ImageRows::Open(file, 1 << 20));
  TestImage image{rows->width(), rows->height(), rows->channels(), {}};
  const size_t bytes = size_t{image.width} * image.channels;
  image.pixels.resize(bytes * image.height);
  for (uint32_t y = 0; y < image.height; ++y) {
    MTDB_RETURN_IF_ERROR(rows->ReadRow(&image.pixels[bytes * y]));
  }
  return image;
}

// By the other reader, which has an alpha of 255 where the file has none.
void CheckAsWhole(const Bytes& file) {
  const TestImage rows = ReadRows(file).value();
  const Pixels whole = DecodeImage(file).value();
  REQUIRE(rows.width == whole.width);
  REQUIRE(rows.height == whole.height);
  for (size_t i = 0; i < size_t{rows.width} * rows.height; ++i) {
    for (size_t c = 0; c < rows.channels; ++c) {
      REQUIRE(rows.pixels[i * rows.channels + c] == whole.rgba[4 * i + c]);
    }
    if (rows.channels == 3) REQUIRE(whole.rgba[4 * i + 3] == 255);
  }
}

}  // namespace

TEST_CASE("PNG files of all kinds come row by row as they were written") {
  for (const uint32_t channels : {3U, 4U}) {
    const TestImage image = WavyImage(53, 31, channels, channels);
    for (const bool interlaced : {false, true}) {
      for (const int bits : {8, 16}) {
        CAPTURE(channels, interlaced, bits);
        const Bytes file = PngOf(image, {bits, false, interlaced});
        const TestImage read = ReadRows(file).value();
        CHECK(read.channels == channels);
        CHECK(read.pixels == image.pixels);
        CheckAsWhole(file);
        const TestImage grey = ReadRows(PngOf(image, {bits, true, interlaced})).value();
        REQUIRE(grey.pixels.size() == image.pixels.size());
        for (size_t i = 0; i < grey.pixels.size(); ++i) {
          const size_t c = i % channels;
          REQUIRE(grey.pixels[i] == image.pixels[c == 3 ? i : i - c]);
        }
      }
    }
  }
  // A single row or column has fewer passes than others.
  for (const auto& [width, height] : {std::pair(1U, 1U), std::pair(9U, 1U), std::pair(1U, 9U)}) {
    const TestImage image = WavyImage(width, height, 3, 5);
    CHECK(ReadRows(PngOf(image, {8, false, true})).value().pixels == image.pixels);
  }
}

TEST_CASE("JPEG files come row by row as they come whole") {
  const TestImage image = WavyImage(67, 41, 3, 3);
  for (const bool progressive : {false, true}) {
    for (const bool grey : {false, true}) CheckAsWhole(JpegOf(image, 90, progressive, grey));
  }
}

TEST_CASE("an image that is cut off or changed is refused or read, and nothing else") {
  const TestImage image = WavyImage(40, 30, 4, 9);
  TestImage opaque = WavyImage(40, 30, 3, 9);
  for (const Bytes& file : {PngOf(image), PngOf(image, {8, false, true}), JpegOf(opaque, 80),
                            JpegOf(opaque, 80, true)}) {
    for (size_t size = 0; size + 12 < file.size(); ++size) {
      const auto read = ReadRows(Bytes(file.begin(), file.begin() + static_cast<ptrdiff_t>(size)));
      // Behind the last row there are only a few bytes.
      if (size + 32 < file.size()) CHECK(!read.ok());
    }
    for (size_t at = 0; at < file.size(); ++at) {
      Bytes other = file;
      other[at] ^= std::byte{0x15};
      const auto read = ReadRows(other);
      const StatusCode code = read.status().code();
      CHECK((code == StatusCode::kOk || code == StatusCode::kBadInput ||
             code == StatusCode::kUnsupported));
    }
  }
  CHECK(ReadRows({}).status().code() == StatusCode::kBadInput);
}

TEST_CASE("an image that would take too much memory is refused before it is read") {
  const TestImage image = WavyImage(64, 64, 3, 2);
  // In rows: none at once. Interlaced: its pixels. Progressive: two bytes a coefficient, of which
  // colours have a quarter.
  const std::vector<std::pair<Bytes, uint64_t>> files{{PngOf(image), 0},
                                                      {JpegOf(image, 90), 0},
                                                      {PngOf(image, {8, false, true}), 3 * 64 * 64},
                                                      {JpegOf(image, 90, true), 3 * 64 * 64}};
  for (const auto& [file, bytes] : files) {
    CHECK(ImageRows::Open(file, bytes).ok());
    if (bytes == 0) continue;
    CHECK(ImageRows::Open(file, bytes - 1).status().code() == StatusCode::kUnsupported);
  }
  const TestImage wide{65537, 1, 3, std::vector<uint8_t>(3 * 65537)};
  CHECK(ImageRows::Open(PngOf(wide), 1 << 30).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("what is encoded comes back") {
  for (const uint32_t channels : {3U, 4U}) {
    const TestImage image = WavyImage(91, 17, channels, 7);
    for (const bool fast : {false, true}) {
      const Bytes file = EncodePng(image.width, image.height, channels, image.pixels, fast).value();
      CHECK(ReadRows(file).value().pixels == image.pixels);
    }
  }
  const TestImage image = WavyImage(91, 17, 3, 7);
  const TestImage read =
      ReadRows(EncodeJpeg(image.width, image.height, image.pixels, 95).value()).value();
  double sum = 0;
  for (size_t i = 0; i < image.pixels.size(); ++i) {
    const double d = static_cast<double>(image.pixels[i]) - read.pixels[i];
    sum += d * d;
  }
  CHECK(sum / static_cast<double>(image.pixels.size()) < 20);
}

}  // namespace mtdb::testing
