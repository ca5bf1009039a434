// SPDX-License-Identifier: Apache-2.0
#include "builder/disk/spool.h"

#include <cerrno>
#include <sys/statvfs.h>
#include <unistd.h>
#include <utility>

#include "store/files/posix_file.h"

namespace mtdb::internal {

namespace {

Status FileError(const std::string& directory, const char* what, int error) {
  const StatusCode code = FileErrorCode(error);
  const bool full = code == StatusCode::kNoSpace;
  return Status(code, directory + ": temporary file: " + what + ": " + std::strerror(error) +
                          (full ? "; free some space, or name another folder with --tmp" : ""));
}

}  // namespace

Status SpoolSpace::Take(uint64_t bytes) const {
  const uint64_t before = file_bytes.fetch_add(bytes);
  if (before <= max_bytes && bytes <= max_bytes - before) return Status::Ok();
  file_bytes -= bytes;
  return {StatusCode::kBudgetExceeded,
          directory + ": temporary files have reached " + std::to_string(before >> 20) +
              " MiB and need more, but " + std::to_string(max_bytes >> 20) +
              " MiB are allowed; allow more temporary files (--max-tmp) or more --memory"};
}

Status SpoolSpace::CheckRoom(uint64_t bytes) const {
  if (bytes == 0) return Status::Ok();
  struct statvfs fs;
  if (statvfs(directory.c_str(), &fs) != 0) {
    return IoError(directory + ": " + std::strerror(errno) +
                   "; name a folder for temporary files with --tmp");
  }
  const uint64_t have = static_cast<uint64_t>(fs.f_bavail) * fs.f_frsize;
  if (bytes <= have) return Status::Ok();
  return {StatusCode::kNoSpace, directory + ": temporary files need up to " +
                                    std::to_string(bytes >> 20) + " MiB, but only " +
                                    std::to_string(have >> 20) +
                                    " MiB are free; name another folder with --tmp, or allow "
                                    "more --memory"};
}

Spool::~Spool() { Close(); }

void Spool::Close() {
  if (file_ < 0) return;
  close(file_);
  file_ = -1;
  space_->file_bytes -= written_ - dropped_;
}

Spool::Spool(Spool&& other) noexcept
    : space_(other.space_),
      memory_bytes_(other.memory_bytes_),
      chunks_(std::move(other.chunks_)),
      free_(std::exchange(other.free_, 0)),
      file_(std::exchange(other.file_, -1)),
      size_(other.size_),
      written_(other.written_),
      dropped_(other.dropped_),
      can_drop_(other.can_drop_) {}

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
    dropped_ = other.dropped_;
    can_drop_ = other.can_drop_;
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
  file_ = OpenNamelessFile(space_->directory, "mtdb-");
  return file_ >= 0 ? Status::Ok() : FileError(space_->directory, "create", errno);
}

Status Spool::Flush(size_t last_bytes) {
  for (const auto& chunk : chunks_) {
    const size_t size = &chunk == &chunks_.back() ? last_bytes : kChunk;
    MTDB_RETURN_IF_ERROR(space_->Take(size));
    if (!WriteFully(file_, written_, chunk.get(), size)) {
      const int error = errno;
      space_->file_bytes -= size;
      return FileError(space_->directory, "write", error);
    }
    written_ += size;
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
  const ssize_t n = ReadFully(file_, offset, to, size);
  if (n == static_cast<ssize_t>(size)) return Status::Ok();
  return FileError(space_->directory, "read", n < 0 ? errno : EIO);
}

void Spool::Drop(uint64_t offset) {
  const uint64_t end = offset / kBlock * kBlock;
  if (file_ < 0 || !can_drop_ || end <= dropped_) return;
  can_drop_ = PunchHole(file_, dropped_, end - dropped_);
  if (!can_drop_) return;
  space_->file_bytes -= end - dropped_;
  dropped_ = end;
}

bool SpoolReader::Refill(size_t size) {
  MTDB_CHECK(remaining() >= size, "a read beyond the end of a spool");
  const size_t kept = filled_ - at_;
  if (consumed_ != nullptr) consumed_->Drop(next_ - kept);
  if (kept != 0) std::memmove(buffer_.data(), buffer_.data() + at_, kept);
  const auto fresh =
      static_cast<size_t>(std::min<uint64_t>(end_ - next_, std::max(block_, size) - kept));
  if (buffer_.size() < kept + fresh) buffer_.resize(kept + fresh);
  filled_ = kept + fresh;
  at_ = 0;
  status_ = spool_->Read(next_, buffer_.data() + kept, fresh);
  next_ += fresh;
  return status_.ok();
}

}  // namespace mtdb::internal
