// SPDX-License-Identifier: Apache-2.0
// Spool: bytes written once, front to back, and read front to back; in memory while they are few,
// then in a temporary file without a name, which the system removes however the process ends.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/check.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Where spools put their files, and how much they hold now.
struct SpoolSpace {
  std::string directory;  // must exist
  uint64_t max_bytes = ~uint64_t{0};
  mutable std::atomic<uint64_t> file_bytes{0};
  // Before so many bytes are written; kBudgetExceeded when all files would have more than
  // max_bytes.
  Status Take(uint64_t bytes) const;
  // kNoSpace when the file system has not so many bytes left.
  Status CheckRoom(uint64_t bytes) const;
};

class Spool {
 public:
  // Up to `memory_bytes`, and in any case kChunk, are kept in memory; a file is made when more is
  // written. After that, memory holds one chunk.
  Spool(const SpoolSpace* space, size_t memory_bytes)
      : space_(space), memory_bytes_(memory_bytes) {}
  ~Spool();
  Spool(Spool&& other) noexcept;
  Spool& operator=(Spool&& other) noexcept;

  // Errors: kNoSpace, kIoError, naming the directory.
  Status Append(const void* data, size_t size) {
    if (size > free_) return AppendAcross(static_cast<const std::byte*>(data), size);
    std::memcpy(chunks_.back().get() + (kChunk - free_), data, size);
    free_ -= size;
    size_ += size;
    return Status::Ok();
  }
  // After the last Append, before the first read.
  Status Finish();
  uint64_t size() const { return size_; }
  // Copies [offset, offset + size) out. Any number of threads after Finish().
  Status Read(uint64_t offset, void* data, size_t size) const;
  // What lies before `offset` is not read again: its room on the disk goes back, where the file
  // system can do that.
  void Drop(uint64_t offset);

  static constexpr size_t kChunk = size_t{1} << 18;
  static constexpr size_t kBlock = size_t{1} << 20;  // that readers take at once

 private:
  void Close();
  Status AppendAcross(const std::byte* data, size_t size);
  // Makes room in the last chunk.
  Status NextChunk();
  Status CreateFile();
  // Writes the chunks to the file; `last_bytes` of the last one.
  Status Flush(size_t last_bytes);

  const SpoolSpace* space_;
  size_t memory_bytes_;
  std::vector<std::unique_ptr<std::byte[]>> chunks_;  // all, or the one not written yet
  size_t free_ = 0;                                   // in the last chunk
  int file_ = -1;
  uint64_t size_ = 0;
  uint64_t written_ = 0;
  uint64_t dropped_ = 0;  // of what was written
  bool can_drop_ = true;
};

// Reads a finished spool from `offset` on, in blocks.
class SpoolReader {
 public:
  explicit SpoolReader(const Spool* spool, uint64_t offset = 0, uint64_t end = ~uint64_t{0},
                       size_t block = Spool::kBlock)
      : spool_(spool), next_(offset), end_(std::min(end, spool->size())), block_(block) {}
  // One that drops what it has read.
  static SpoolReader Consuming(Spool* spool, size_t block = Spool::kBlock) {
    SpoolReader reader(spool, 0, ~uint64_t{0}, block);
    reader.consumed_ = spool;
    return reader;
  }
  uint64_t remaining() const { return end_ - next_ + (filled_ - at_); }
  // The next `size` bytes, valid until the next call; null when the read failed (see status()).
  const std::byte* Next(size_t size) {
    if (filled_ - at_ < size && !Refill(size)) return nullptr;
    const std::byte* p = buffer_.data() + at_;
    at_ += size;
    return p;
  }
  // For what has no size of its own: the next bytes, of which `most` may be looked at (behind the
  // last one they mean nothing), valid until the next call; then Skip() what was taken. Null when
  // the read failed.
  const std::byte* Peek(size_t most) {
    if (filled_ - at_ < most && next_ < end_ && !Refill(std::min<uint64_t>(most, remaining()))) {
      return nullptr;
    }
    if (buffer_.size() < at_ + most) buffer_.resize(at_ + most);
    return buffer_.data() + at_;
  }
  void Skip(size_t size) {
    MTDB_CHECK(size <= filled_ - at_, "a record beyond the end of a spool");
    at_ += size;
  }
  // Likewise, copied; false when the read failed.
  template <typename T>
  requires std::is_trivially_copyable_v<T>
  bool Get(T* value) {
    const std::byte* p = Next(sizeof(T));
    if (p != nullptr) std::memcpy(value, p, sizeof(T));
    return p != nullptr;
  }
  const Status& status() const { return status_; }

 private:
  bool Refill(size_t size);
  const Spool* spool_;
  uint64_t next_;
  uint64_t end_;
  size_t block_;
  Bytes buffer_;
  size_t filled_ = 0;  // of the buffer
  size_t at_ = 0;
  Spool* consumed_ = nullptr;
  Status status_;
};

}  // namespace mtdb::internal
