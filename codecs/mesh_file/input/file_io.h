// SPDX-License-Identifier: Apache-2.0
// Reading files in blocks with pread, and writing them so that they appear whole or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb::internal {

// An open regular file. Not mapped: mapped pages would count as memory of the process.
class InputFile {
 public:
  // kNotFound, kIoError (a directory, a pipe, no permission).
  static Result<std::unique_ptr<InputFile>> Open(const std::string& path);
  // An open regular file; takes the descriptor. `path` is for messages.
  static Result<std::unique_ptr<InputFile>> Take(int descriptor, const std::string& path);
  // A copy of the descriptor of a file that is still being written, as if it had so many bytes.
  static Result<std::unique_ptr<InputFile>> Growing(int descriptor, const std::string& path,
                                                    uint64_t size_bytes);
  // The same file, for somebody who may outlive this. Its reads call nobody.
  Result<std::unique_ptr<InputFile>> Copy() const {
    return Growing(descriptor_, path_, size_bytes_);
  }
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  const std::string& path() const { return path_; }
  uint64_t size_bytes() const { return size_bytes_; }
  // Is called before each read; its error is the read's.
  void SetLook(std::function<Status()> look) { look_ = std::move(look); }
  // Fills `out` from `offset` on and returns how much there was: less only at the end of the file.
  Result<size_t> ReadAt(uint64_t offset, std::span<std::byte> out) const;

 private:
  InputFile(std::string path, int descriptor, uint64_t size_bytes)
      : path_(std::move(path)), descriptor_(descriptor), size_bytes_(size_bytes) {}

  std::string path_;
  int descriptor_;
  uint64_t size_bytes_;
  std::function<Status()> look_;
};

// A forward cursor over binary data with a buffer of fixed size, or the file's. `file` must outlive
// it.
class BlockReader {
 public:
  static constexpr size_t kBufferBytes = size_t{1} << 20;

  BlockReader(const InputFile& file, uint64_t offset);

  // Makes at least `size_bytes` (<= kBufferBytes) unread bytes contiguous at data(). False when
  // the file ends before, or when reading failed (status()).
  bool Ensure(size_t size_bytes) { return size_bytes <= available() || Fill(size_bytes); }
  const std::byte* data() const { return buffer_.data() + begin_; }
  size_t available() const { return end_ - begin_; }
  void Consume(size_t size_bytes) { begin_ += size_bytes; }
  // Steps over bytes without reading them. False when the file ends before.
  bool Skip(uint64_t size_bytes);

  uint64_t offset() const { return file_end_ - available(); }  // of data() in the file
  uint64_t remaining() const;                                  // from data() to the file's end
  const Status& status() const { return status_; }

 private:
  bool Fill(size_t size_bytes);

  const InputFile& file_;
  std::vector<std::byte> buffer_;
  size_t begin_ = 0;
  size_t end_ = 0;
  uint64_t file_end_;  // offset of the first byte that is not yet in the buffer
  Status status_;
};

}  // namespace mtdb::internal
