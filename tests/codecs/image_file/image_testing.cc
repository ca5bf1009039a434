// SPDX-License-Identifier: Apache-2.0
#include "tests/codecs/image_file/image_testing.h"

#include <algorithm>
#include <cmath>
#include <cstdio>  // jpeglib.h needs it
#include <cstdlib>
#include <jpeglib.h>
#include <memory>
#include <png.h>
#include <random>

namespace mtdb::testing {

TestImage WavyImage(uint32_t width, uint32_t height, uint32_t channels, uint64_t seed) {
  TestImage image{width, height, channels, {}};
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0.01, 0.08);
  double waves[3][2];
  for (auto& wave : waves) {
    for (double& w : wave) w = uniform(random);
  }
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      for (uint32_t c = 0; c < channels; ++c) {
        double value = 255.0 * x / std::max(1U, width - 1);
        if (c < 3) {
          value =
              127.5 + 100 * std::sin(waves[c][0] * x + waves[c][1] * y) + (2 * x > width ? 25 : 0);
        }
        image.pixels.push_back(static_cast<uint8_t>(std::lround(value)));
      }
    }
  }
  return image;
}

Bytes PngOf(const TestImage& image, const PngKind& kind) {
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  Bytes file;
  png_set_write_fn(
      png, &file,
      [](png_structp writer, png_bytep data, size_t size) {
        auto* const to = static_cast<Bytes*>(png_get_io_ptr(writer));
        const auto* const from = reinterpret_cast<const std::byte*>(data);
        to->insert(to->end(), from, from + size);
      },
      nullptr);
  const bool alpha = image.channels == 4;
  const int type = kind.grey ? (alpha ? PNG_COLOR_TYPE_GRAY_ALPHA : PNG_COLOR_TYPE_GRAY)
                             : (alpha ? PNG_COLOR_TYPE_RGBA : PNG_COLOR_TYPE_RGB);
  png_set_IHDR(png, info, image.width, image.height, kind.bits, type,
               kind.interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  std::vector<std::vector<uint8_t>> rows(image.height);
  std::vector<png_bytep> pointers;
  for (uint32_t y = 0; y < image.height; ++y) {
    for (uint32_t x = 0; x < image.width; ++x) {
      for (uint32_t c = 0; c < image.channels; ++c) {
        if (kind.grey && (c == 1 || c == 2)) continue;
        rows[y].push_back(image.At(x, y)[c]);
        if (kind.bits == 16) rows[y].push_back(image.At(x, y)[c]);
      }
    }
    pointers.push_back(rows[y].data());
  }
  png_write_image(png, pointers.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return file;
}

Bytes JpegOf(const TestImage& image, int quality, bool progressive, bool grey) {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = image.width;
  jpeg.image_height = image.height;
  jpeg.input_components = grey ? 1 : 3;
  jpeg.in_color_space = grey ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  if (progressive) jpeg_simple_progression(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  for (uint32_t y = 0; y < image.height; ++y) {
    std::vector<uint8_t> row;
    for (uint32_t x = 0; x < image.width; ++x) {
      for (int c = 0; c < jpeg.input_components; ++c) row.push_back(image.At(x, y)[c]);
    }
    JSAMPROW line = row.data();
    jpeg_write_scanlines(&jpeg, &line, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  const std::unique_ptr<unsigned char, void (*)(void*)> owner(bytes, std::free);
  const auto* const begin = reinterpret_cast<const std::byte*>(bytes);
  return {begin, begin + size};
}

}  // namespace mtdb::testing
