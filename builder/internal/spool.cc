#include "builder/internal/spool.h"

#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <unistd.h>
#include <utility>

namespace mtdb {

namespace {

Status FileError(const std::string& directory, const char* what, int error) {
  const bool full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return Status(full ? StatusCode::kNoSpace : StatusCode::kIoError,
                directory + ": temporary file: " + what + ": " + std::strerror(error) +
                    (full ? "; free some space, or name another folder with --tmp" : ""));
}

}  // namespace

Spool::~Spool() { Close(); }

void Spool::Close() {
  if (file_ < 0) return;
  close(file_);
  file_ = -1;
  space_->file_bytes -= written_;
}

Spool::Spool(Spool&& other) noexcept
    : space_(other.space_),
      memory_bytes_(other.memory_bytes_),
      buffer_(std::move(other.buffer_)),
      file_(std::exchange(other.file_, -1)),
      size_(other.size_),
      written_(other.written_) {}

Spool& Spool::operator=(Spool&& other) noexcept {
  if (this != &other) {
    Close();
    space_ = other.space_;
    memory_bytes_ = other.memory_bytes_;
    buffer_ = std::move(other.buffer_);
    file_ = std::exchange(other.file_, -1);
    size_ = other.size_;
    written_ = other.written_;
  }
  return *this;
}

Status Spool::Flush() {
  size_t done = 0;
  while (done < buffer_.size()) {
    const ssize_t n = pwrite(file_, buffer_.data() + done, buffer_.size() - done,
                             static_cast<off_t>(written_ + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return FileError(space_->directory, "write", n == 0 ? EIO : errno);
    done += static_cast<size_t>(n);
  }
  written_ += done;
  space_->file_bytes += done;
  buffer_.clear();
  return Status::Ok();
}

Status Spool::Spill(size_t next) {
  if (file_ < 0) {
    file_ = open(space_->directory.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (file_ < 0) {  // a file system without O_TMPFILE
      std::string name = space_->directory + "/mtdb-" + std::string(6, 'X');
      file_ = mkostemp(name.data(), O_CLOEXEC);
      if (file_ < 0) return FileError(space_->directory, "create", errno);
      unlink(name.c_str());
    }
  }
  MTDB_RETURN_IF_ERROR(Flush());
  if (buffer_.capacity() > 2 * kBlock) Bytes().swap(buffer_);
  buffer_.reserve(std::max(kBlock, next));
  return Status::Ok();
}

Status Spool::Finish() {
  if (file_ < 0) return Status::Ok();
  MTDB_RETURN_IF_ERROR(Flush());
  Bytes().swap(buffer_);
  return Status::Ok();
}

Status Spool::Read(uint64_t offset, void* data, size_t size) const {
  MTDB_CHECK(offset + size <= size_, "a read beyond the end of a spool");
  if (file_ < 0) {
    std::memcpy(data, buffer_.data() + offset, size);
    return Status::Ok();
  }
  size_t done = 0;
  while (done < size) {
    const ssize_t n = pread(file_, static_cast<std::byte*>(data) + done, size - done,
                            static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return FileError(space_->directory, "read", n == 0 ? EIO : errno);
    done += static_cast<size_t>(n);
  }
  return Status::Ok();
}

bool SpoolReader::Refill(size_t size) {
  MTDB_CHECK(remaining() >= size, "a read beyond the end of a spool");
  const size_t kept = buffer_.size() - at_;
  std::memmove(buffer_.data(), buffer_.data() + at_, kept);
  const auto fresh =
      static_cast<size_t>(std::min<uint64_t>(end_ - next_, std::max(block_, size) - kept));
  buffer_.resize(kept + fresh);
  at_ = 0;
  status_ = spool_->Read(next_, buffer_.data() + kept, fresh);
  next_ += fresh;
  return status_.ok();
}

}  // namespace mtdb
