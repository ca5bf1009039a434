#include "codecs/internal/file_io.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

namespace mtdb {
namespace {

// As strerror, which is not safe for threads.
std::string ErrorText(int error) { return std::generic_category().message(error); }

Status WriteError(const std::string& path, int error) {
  std::string message = path + ": cannot be written: " + ErrorText(error);
  if (error == ENOSPC || error == EDQUOT || error == EFBIG) {
    return {StatusCode::kNoSpace, message + "; make room or choose another place"};
  }
  return IoError(std::move(message));
}

}  // namespace

Result<std::unique_ptr<InputFile>> InputFile::Open(const std::string& path) {
  // O_NONBLOCK: opening a pipe must not wait for a writer.
  const int descriptor =
      TEMP_FAILURE_RETRY(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (descriptor < 0) {
    const int error = errno;
    if (error == ENOENT || error == ENOTDIR) return NotFound(path + ": no such file");
    return IoError(path + ": cannot be opened: " + ErrorText(error));
  }
  struct stat info {};
  if (::fstat(descriptor, &info) != 0) {
    const int error = errno;
    ::close(descriptor);
    return IoError(path + ": cannot be read: " + ErrorText(error));
  }
  if (!S_ISREG(info.st_mode)) {
    ::close(descriptor);
    return IoError(path + (S_ISDIR(info.st_mode) ? ": is a directory, expected a mesh file"
                                                 : ": is not a regular file; copy it to one"));
  }
  (void)::posix_fadvise(descriptor, 0, 0, POSIX_FADV_SEQUENTIAL);
  return std::unique_ptr<InputFile>(
      new InputFile(path, descriptor, static_cast<uint64_t>(info.st_size)));
}

InputFile::~InputFile() { ::close(descriptor_); }

Result<size_t> InputFile::ReadAt(uint64_t offset, std::span<std::byte> out) const {
  size_t done = 0;
  while (done < out.size()) {
    const ssize_t n = ::pread(descriptor_, out.data() + done, out.size() - done,
                              static_cast<off_t>(offset + done));
    if (n == 0) break;
    if (n < 0) {
      if (errno == EINTR) continue;
      return IoError(path_ + ": byte " + std::to_string(offset + done) +
                     ": cannot be read: " + ErrorText(errno));
    }
    done += static_cast<size_t>(n);
  }
  return done;
}

BlockReader::BlockReader(const InputFile& file, uint64_t offset)
    : file_(file),
      buffer_(std::clamp<uint64_t>(file.size_bytes(), 1, kBufferBytes)),
      file_end_(offset) {}

bool BlockReader::Fill(size_t size_bytes) {
  if (!status_.ok()) return false;
  std::memmove(buffer_.data(), buffer_.data() + begin_, available());
  end_ -= begin_;
  begin_ = 0;
  Result<size_t> n = file_.ReadAt(file_end_, std::span(buffer_).subspan(end_));
  if (!n.ok()) {
    status_ = n.status();
    return false;
  }
  end_ += *n;
  file_end_ += *n;
  return available() >= size_bytes;
}

bool BlockReader::Skip(uint64_t size_bytes) {
  if (size_bytes <= available()) {
    begin_ += size_bytes;
    return true;
  }
  if (size_bytes > remaining()) return false;
  file_end_ += size_bytes - available();
  begin_ = end_ = 0;
  return true;
}

uint64_t BlockReader::remaining() const {
  return file_.size_bytes() > offset() ? file_.size_bytes() - offset() : 0;
}

Result<std::unique_ptr<AtomicFile>> AtomicFile::Create(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode)) {
    return IoError(path + ": is a directory, expected the name of a file");
  }
  static std::atomic<uint64_t> next{0};
  for (int attempt = 0;; ++attempt) {
    std::string temporary =
        path + "." + std::to_string(::getpid()) + "-" + std::to_string(next++) + ".tmp";
    const int descriptor = TEMP_FAILURE_RETRY(
        ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    if (descriptor >= 0) {
      return std::unique_ptr<AtomicFile>(new AtomicFile(path, std::move(temporary), descriptor));
    }
    if (errno == EEXIST && attempt < 1000) continue;  // left behind by a process of the same id
    return WriteError(path, errno);
  }
}

Result<std::unique_ptr<AtomicFile>> AtomicFile::Into(int descriptor, const std::string& path) {
  const int own = ::fcntl(descriptor, F_DUPFD_CLOEXEC, 0);
  if (own < 0) return WriteError(path, errno);
  return std::unique_ptr<AtomicFile>(new AtomicFile(path, "", own));
}

AtomicFile::AtomicFile(std::string path, std::string temporary, int descriptor)
    : path_(std::move(path)),
      temporary_(std::move(temporary)),
      descriptor_(descriptor),
      buffer_(size_t{1} << 20) {}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

Status AtomicFile::Append(ByteSpan bytes) {
  bytes_written_ += bytes.size();
  if (bytes.size() > buffer_.size() - buffered_) {
    MTDB_RETURN_IF_ERROR(Flush());
    if (bytes.size() >= buffer_.size()) return WriteAll(bytes);
  }
  if (!bytes.empty()) std::memcpy(buffer_.data() + buffered_, bytes.data(), bytes.size());
  buffered_ += bytes.size();
  return Status::Ok();
}

Status AtomicFile::Flush() {
  const ByteSpan bytes = ByteSpan(buffer_).first(buffered_);
  buffered_ = 0;
  return WriteAll(bytes);
}

Status AtomicFile::Overwrite(uint64_t offset, ByteSpan bytes) {
  MTDB_CHECK(offset + bytes.size() <= bytes_written_, "only what was appended is overwritten");
  MTDB_RETURN_IF_ERROR(Flush());
  return WriteAll(bytes, offset);
}

Status AtomicFile::WriteAll(ByteSpan bytes, std::optional<uint64_t> offset) {
  while (!bytes.empty()) {
    const ssize_t n =
        offset ? ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(*offset))
               : ::write(descriptor_, bytes.data(), bytes.size());
    if (n < 0) {
      if (errno == EINTR) continue;
      return WriteError(path_, errno);
    }
    bytes = bytes.subspan(static_cast<size_t>(n));
    if (offset) *offset += static_cast<uint64_t>(n);
  }
  return Status::Ok();
}

Status AtomicFile::Commit() {
  MTDB_RETURN_IF_ERROR(Flush());
  if (!temporary_.empty() && ::fdatasync(descriptor_) != 0) return WriteError(path_, errno);
  const int closed = ::close(std::exchange(descriptor_, -1));
  if (closed != 0) return WriteError(path_, errno);
  if (temporary_.empty()) return Status::Ok();
  if (std::rename(temporary_.c_str(), path_.c_str()) != 0) return WriteError(path_, errno);
  temporary_.clear();
  return Status::Ok();
}

}  // namespace mtdb
