// Spool: bytes written once, front to back, and read front to back; in memory while they are few,
// then in a temporary file without a name, which the system removes however the process ends.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb {

// Where spools put their files, and how much they hold now.
struct SpoolSpace {
  std::string directory;  // must exist
  mutable std::atomic<uint64_t> file_bytes{0};
};

class Spool {
 public:
  // Up to `memory_bytes` are kept in memory; a file is made when more is written. After that,
  // memory holds a write buffer of at most kBlock bytes.
  Spool(const SpoolSpace* space, size_t memory_bytes)
      : space_(space), memory_bytes_(memory_bytes) {}
  ~Spool();
  Spool(Spool&& other) noexcept;
  Spool& operator=(Spool&& other) noexcept;

  // Errors: kNoSpace, kIoError, naming the directory.
  Status Append(const void* data, size_t size) {
    if (buffer_.size() + size > buffer_limit()) MTDB_RETURN_IF_ERROR(Spill(size));
    const auto* begin = static_cast<const std::byte*>(data);
    buffer_.insert(buffer_.end(), begin, begin + size);
    size_ += size;
    return Status::Ok();
  }
  // After the last Append, before the first read.
  Status Finish();
  uint64_t size() const { return size_; }
  // Copies [offset, offset + size) out. Any number of threads after Finish().
  Status Read(uint64_t offset, void* data, size_t size) const;

  static constexpr size_t kBlock = size_t{1} << 20;

 private:
  void Close();
  size_t buffer_limit() const { return file_ < 0 ? memory_bytes_ : kBlock; }
  Status Spill(size_t next);
  Status Flush();

  const SpoolSpace* space_;
  size_t memory_bytes_;
  Bytes buffer_;  // all bytes while file_ < 0, else those not written yet
  int file_ = -1;
  uint64_t size_ = 0;
  uint64_t written_ = 0;
};

// Reads a finished spool from `offset` on, in blocks.
class SpoolReader {
 public:
  explicit SpoolReader(const Spool* spool, uint64_t offset = 0, uint64_t end = ~uint64_t{0},
                       size_t block = Spool::kBlock)
      : spool_(spool), next_(offset), end_(std::min(end, spool->size())), block_(block) {}
  uint64_t remaining() const { return end_ - next_ + (buffer_.size() - at_); }
  // The next `size` bytes, valid until the next call; null when the read failed (see status()).
  const std::byte* Next(size_t size) {
    if (buffer_.size() - at_ < size && !Refill(size)) return nullptr;
    const std::byte* p = buffer_.data() + at_;
    at_ += size;
    return p;
  }
  const Status& status() const { return status_; }

 private:
  bool Refill(size_t size);
  const Spool* spool_;
  uint64_t next_;
  uint64_t end_;
  size_t block_;
  Bytes buffer_;
  size_t at_ = 0;
  Status status_;
};

}  // namespace mtdb
