// SPDX-License-Identifier: Apache-2.0
// Images for tests, and files of all the kinds that PNG and JPEG have.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "store/base/bytes.h"

namespace mtdb::testing {

struct TestImage {
  uint32_t width = 0, height = 0, channels = 3;
  std::vector<uint8_t> pixels;  // rows from the top
  const uint8_t* At(uint32_t x, uint32_t y) const {
    return &pixels[(size_t{y} * width + x) * channels];
  }
};

// Smooth waves with an edge in them; with four channels alpha goes from 0 to 255.
TestImage WavyImage(uint32_t width, uint32_t height, uint32_t channels, uint64_t seed);

struct PngKind {
  int bits = 8;       // a channel
  bool grey = false;  // the first channel alone, and alpha
  bool interlaced = false;
};
Bytes PngOf(const TestImage& image, const PngKind& kind = {});
// Of the first three channels.
Bytes JpegOf(const TestImage& image, int quality, bool progressive = false, bool grey = false);

}  // namespace mtdb::testing
