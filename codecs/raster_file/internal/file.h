// SPDX-License-Identifier: Apache-2.0
// RasterInput: a file that is read at any place.
#pragma once

#include <cstdint>
#include <string>

#include "store/base/status.h"

namespace mtdb::internal {

class RasterInput {
 public:
  // kNotFound, kIoError.
  static Result<RasterInput> Open(const std::string& path);
  RasterInput(RasterInput&& other) noexcept;
  RasterInput& operator=(RasterInput&& other) noexcept;
  ~RasterInput();

  const std::string& path() const { return path_; }
  uint64_t size() const { return size_; }
  // Reads on as if the file's first bytes were not there.
  void SkipFront(uint64_t bytes) {
    front_ += bytes;
    size_ -= bytes;
  }
  // Reads `bytes` bytes at `offset`. kIoError; kBadInput when the file ends before.
  Status Read(uint64_t offset, void* to, size_t bytes) const;

 private:
  RasterInput() = default;
  std::string path_;
  int descriptor_ = -1;
  uint64_t size_ = 0;
  uint64_t front_ = 0;  // bytes before offset 0
};

}  // namespace mtdb::internal
