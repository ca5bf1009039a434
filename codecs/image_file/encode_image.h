// SPDX-License-Identifier: Apache-2.0
// Pixels as image files.
#pragma once

#include <cstdint>
#include <span>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Bytes of pixels, rows from the top, without gaps: 3 or 4 channels, the fourth is alpha, by which
// the others are not multiplied. Throws std::bad_alloc; errors: kIoError (libpng's reason).
// `fast`: some tenths larger, in a fraction of the time.
Result<Bytes> EncodePng(uint32_t width, uint32_t height, uint32_t channels,
                        std::span<const uint8_t> pixels, bool fast = false);
// Of three channels; quality from 1 to 100. `whole_colours`: hues are not halved, which photographs
// do not need, but neighbours of different colours do. Errors: kIoError.
Result<Bytes> EncodeJpeg(uint32_t width, uint32_t height, std::span<const uint8_t> pixels,
                         int quality, bool whole_colours = false);

}  // namespace mtdb
