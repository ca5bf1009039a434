// SPDX-License-Identifier: Apache-2.0
// A temporary file without a name: it goes with the process, however that ends.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "store/base/status.h"

namespace mtdb::internal {

// Open for reading and writing.
class AnonymousFile {
 public:
  AnonymousFile() = default;
  // In `folder`. Where the system knows no files without names it has one for an instant. kIoError,
  // kNoSpace.
  static Result<AnonymousFile> Create(const std::string& folder);
  // Removes from `folder` what a process left that was killed in that instant. Harmless beside
  // others that make such files.
  static void Sweep(const std::string& folder);

  AnonymousFile(AnonymousFile&& other) noexcept
      : descriptor_(std::exchange(other.descriptor_, -1)) {}
  AnonymousFile& operator=(AnonymousFile&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  ~AnonymousFile();

  bool is_open() const { return descriptor_ >= 0; }
  int descriptor() const { return descriptor_; }
  uint64_t size_bytes() const;  // 0 on an error
  // Reads up to `size` bytes; 0 on an error.
  size_t ReadAt(uint64_t offset, char* out, size_t size) const;

 private:
  int descriptor_ = -1;
};

}  // namespace mtdb::internal
