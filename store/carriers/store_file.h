// SPDX-License-Identifier: Apache-2.0
// StoreFile: the bytes of a store file, read by offset and counted. Never mapped.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "store/base/status.h"

namespace mtdb::internal {

// Safe for many threads.
class StoreFile {
 public:
  enum class Access { kRead, kReadWrite, kCreate };

  // Errors: kNotFound, kIoError.
  static Result<std::unique_ptr<StoreFile>> Open(const std::string& path, Access access);
  ~StoreFile();
  StoreFile(const StoreFile&) = delete;
  StoreFile& operator=(const StoreFile&) = delete;

  const std::string& path() const { return path_; }
  uint64_t device() const { return device_; }
  uint64_t inode() const { return inode_; }
  int descriptor() const { return descriptor_; }

  Result<uint64_t> Size() const;
  // Fills `out`; the file's end before that is kCorrupt (the store was truncated).
  Status ReadAt(uint64_t offset, std::span<std::byte> out) const;
  // Bytes that ReadAt has delivered so far.
  uint64_t bytes_read() const { return bytes_read_.load(std::memory_order_relaxed); }

 private:
  StoreFile(std::string path, int descriptor);

  std::string path_;
  int descriptor_ = -1;
  uint64_t device_ = 0;
  uint64_t inode_ = 0;
  mutable std::atomic<uint64_t> bytes_read_{0};
};

}  // namespace mtdb::internal
