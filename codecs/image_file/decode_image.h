// SPDX-License-Identifier: Apache-2.0
// DecodeImage: PNG and JPEG files as pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "store/base/status.h"

namespace mtdb {

struct Pixels {
  size_t width = 0, height = 0;
  // Red, green, blue, alpha as displayed, not multiplied by alpha; rows from the top.
  std::vector<uint8_t> rgba;
};

// Of the file's bytes; a JPEG in grey, YCbCr or RGB, a PNG of any kind. Errors: kBadInput (it is
// neither, or ends too early), kUnsupported (more than 2^27 pixels, CMYK).
Result<Pixels> DecodeImage(const std::string& file);

}  // namespace mtdb
