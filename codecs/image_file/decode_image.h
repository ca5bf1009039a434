// SPDX-License-Identifier: Apache-2.0
// DecodeImage: PNG and JPEG files as pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

struct Pixels {
  size_t width = 0, height = 0;
  // Red, green, blue, alpha as displayed, not multiplied by alpha; rows from the top.
  std::vector<uint8_t> rgba;
};

// Errors: those of ImageRows; kUnsupported when there are more than 2^27 pixels.
Result<Pixels> DecodeImage(ByteSpan file);

}  // namespace mtdb
