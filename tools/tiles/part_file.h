// SPDX-License-Identifier: Apache-2.0
// PartFile: bytes that are written one after the other and read in any order, in a nameless file.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Append() by one thread, then Read() by any.
class PartFile {
 public:
  // In `folder`. kNoSpace, kIoError.
  static Result<std::unique_ptr<PartFile>> Create(const std::string& folder);
  ~PartFile();
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;

  uint64_t size_bytes() const { return size_bytes_; }
  Status Append(ByteSpan bytes);
  // All of `to`, from `offset` on.
  Status Read(uint64_t offset, std::span<std::byte> to) const;

 private:
  PartFile(std::string folder, int file) : folder_(std::move(folder)), file_(file) {}
  std::string folder_;
  int file_;
  uint64_t size_bytes_ = 0;
};

}  // namespace mtdb
