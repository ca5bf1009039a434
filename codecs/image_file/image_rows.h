// SPDX-License-Identifier: Apache-2.0
// ImageRows: an image file row by row, for images that are larger than memory should be.
#pragma once

#include <cstdint>
#include <memory>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Reads PNG (of any kind) and JPEG (grey, YCbCr, RGB). Takes the memory of a few rows; of images
// whose file has not one row after the other (interlaced PNG, progressive JPEG) two to six bytes
// for each pixel. One thread.
class ImageRows {
 public:
  // The file's bytes must outlive it. Errors: kBadInput (neither, or damaged), kUnsupported (CMYK;
  // more than 65,536 pixels on a side, or 2^30 in all; an image that is not in rows, and would take
  // more than `most_at_once` bytes).
  static Result<std::unique_ptr<ImageRows>> Open(ByteSpan file, uint64_t most_at_once);
  virtual ~ImageRows() = default;

  uint32_t width() const { return width_; }
  uint32_t height() const { return height_; }
  // Of a pixel: red, green, blue as displayed, and, if there are 4, alpha, by which they are not
  // multiplied.
  uint32_t channels() const { return channels_; }
  // The next row, from the top: width() * channels() bytes; height() times at most. Errors:
  // kBadInput.
  virtual Status ReadRow(uint8_t* row) = 0;

 protected:
  uint32_t width_ = 0, height_ = 0, channels_ = 3;
};

}  // namespace mtdb
