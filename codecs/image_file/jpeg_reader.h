// SPDX-License-Identifier: Apache-2.0
// JpegReader: the rows of a JPEG file.
#pragma once

#include <cstdint>
#include <memory>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Holds a few rows; of a progressive file up to six bytes for each of its pixels. The file's bytes
// must outlive it. One thread.
class JpegReader {
 public:
  // Errors: kBadInput, kUnsupported (CMYK).
  static Result<std::unique_ptr<JpegReader>> Open(ByteSpan file);
  ~JpegReader();

  uint32_t width() const;
  uint32_t height() const;
  // That it takes of a file that has not its rows one after the other; 0 of others.
  uint64_t bytes_at_once() const;
  // The next row, from the top: red, green, blue of each pixel. Errors: kBadInput, kNoMemory.
  Status ReadRow(uint8_t* row);

 private:
  struct State;
  explicit JpegReader(std::unique_ptr<State> state);
  const std::unique_ptr<State> state_;
};

}  // namespace mtdb::internal
