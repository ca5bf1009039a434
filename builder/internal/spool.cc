#include "builder/internal/spool.h"

#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <unistd.h>
#include <utility>

namespace mtdb::internal {

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
      chunks_(std::move(other.chunks_)),
      free_(std::exchange(other.free_, 0)),
      file_(std::exchange(other.file_, -1)),
      size_(other.size_),
      written_(other.written_) {}

Spool& Spool::operator=(Spool&& other) noexcept {
  if (this != &other) {
    Close();
    space_ = other.space_;
    memory_bytes_ = other.memory_bytes_;
    chunks_ = std::move(other.chunks_);
    free_ = std::exchange(other.free_, 0);
    file_ = std::exchange(other.file_, -1);
    size_ = other.size_;
    written_ = other.written_;
  }
  return *this;
}

Status Spool::AppendAcross(const std::byte* data, size_t size) {
  while (size > 0) {
    if (free_ == 0) MTDB_RETURN_IF_ERROR(NextChunk());
    const size_t part = std::min(size, free_);
    std::memcpy(chunks_.back().get() + (kChunk - free_), data, part);
    free_ -= part;
    size_ += part;
    data += part;
    size -= part;
  }
  return Status::Ok();
}

Status Spool::NextChunk() {
  const bool full = (chunks_.size() + 1) * kChunk > std::max(memory_bytes_, kChunk);
  if (file_ < 0 && full) MTDB_RETURN_IF_ERROR(CreateFile());
  if (file_ >= 0 && !chunks_.empty()) {
    MTDB_RETURN_IF_ERROR(Flush(kChunk));
    chunks_.resize(1);
  } else {
    chunks_.push_back(std::make_unique_for_overwrite<std::byte[]>(kChunk));
  }
  free_ = kChunk;
  return Status::Ok();
}

Status Spool::CreateFile() {
  file_ = open(space_->directory.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (file_ < 0) {  // a file system without O_TMPFILE
    std::string name = space_->directory + "/mtdb-" + std::string(6, 'X');
    file_ = mkostemp(name.data(), O_CLOEXEC);
    if (file_ < 0) return FileError(space_->directory, "create", errno);
    unlink(name.c_str());
  }
  return Status::Ok();
}

Status Spool::Flush(size_t last_bytes) {
  for (const auto& chunk : chunks_) {
    const size_t size = &chunk == &chunks_.back() ? last_bytes : kChunk;
    for (size_t done = 0; done < size;) {
      const ssize_t n =
          pwrite(file_, chunk.get() + done, size - done, static_cast<off_t>(written_));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) return FileError(space_->directory, "write", n == 0 ? EIO : errno);
      done += static_cast<size_t>(n);
      written_ += static_cast<size_t>(n);
      space_->file_bytes += static_cast<size_t>(n);
    }
  }
  return Status::Ok();
}

Status Spool::Finish() {
  if (file_ < 0) return Status::Ok();
  MTDB_RETURN_IF_ERROR(Flush(kChunk - free_));
  chunks_.clear();
  free_ = 0;
  return Status::Ok();
}

Status Spool::Read(uint64_t offset, void* data, size_t size) const {
  MTDB_CHECK(offset + size <= size_, "a read beyond the end of a spool");
  auto* to = static_cast<std::byte*>(data);
  if (file_ < 0) {
    while (size > 0) {
      const size_t at = offset % kChunk;
      const size_t part = std::min(size, kChunk - at);
      std::memcpy(to, chunks_[offset / kChunk].get() + at, part);
      to += part;
      offset += part;
      size -= part;
    }
    return Status::Ok();
  }
  while (size > 0) {
    const ssize_t n = pread(file_, to, size, static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return FileError(space_->directory, "read", n == 0 ? EIO : errno);
    to += n;
    offset += static_cast<uint64_t>(n);
    size -= static_cast<size_t>(n);
  }
  return Status::Ok();
}

bool SpoolReader::Refill(size_t size) {
  MTDB_CHECK(remaining() >= size, "a read beyond the end of a spool");
  const size_t kept = buffer_.size() - at_;
  if (kept != 0) std::memmove(buffer_.data(), buffer_.data() + at_, kept);
  const auto fresh =
      static_cast<size_t>(std::min<uint64_t>(end_ - next_, std::max(block_, size) - kept));
  buffer_.resize(kept + fresh);
  at_ = 0;
  status_ = spool_->Read(next_, buffer_.data() + kept, fresh);
  next_ += fresh;
  return status_.ok();
}

}  // namespace mtdb::internal
