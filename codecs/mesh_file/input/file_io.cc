// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/input/file_io.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

#include "store/files/posix_file.h"

namespace mtdb::internal {
namespace {

// As strerror, which is not safe for threads.
std::string ErrorText(int error) { return std::generic_category().message(error); }

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
  return Take(descriptor, path);
}

Result<std::unique_ptr<InputFile>> InputFile::Take(int descriptor, const std::string& path) {
  struct stat info {};
  if (::fstat(descriptor, &info) != 0) {
    const int error = errno;
    ::close(descriptor);
    return IoError(path + ": cannot be read: " + ErrorText(error));
  }
  if (!S_ISREG(info.st_mode)) {
    ::close(descriptor);
    return IoError(path + (S_ISDIR(info.st_mode)
                               ? ": is a directory, expected a mesh file"
                               : ": is not a regular file; copy it to one, or pipe it "
                                 "to standard input"));
  }
  (void)::posix_fadvise(descriptor, 0, 0, POSIX_FADV_SEQUENTIAL);
  return std::unique_ptr<InputFile>(
      new InputFile(path, descriptor, static_cast<uint64_t>(info.st_size)));
}

Result<std::unique_ptr<InputFile>> InputFile::Growing(int descriptor, const std::string& path,
                                                      uint64_t size_bytes) {
  const int own = ::fcntl(descriptor, F_DUPFD_CLOEXEC, 0);
  if (own < 0) return IoError(path + ": cannot be read: " + ErrorText(errno));
  return std::unique_ptr<InputFile>(new InputFile(path, own, size_bytes));
}

InputFile::~InputFile() { ::close(descriptor_); }

Result<size_t> InputFile::ReadAt(uint64_t offset, std::span<std::byte> out) const {
  if (look_) MTDB_RETURN_IF_ERROR(look_());
  const ssize_t n = ReadFully(descriptor_, offset, out.data(), out.size());
  if (n >= 0) return static_cast<size_t>(n);
  return IoError(path_ + ": " + std::to_string(out.size()) + " bytes at byte " +
                 std::to_string(offset) + ": cannot be read: " + ErrorText(errno));
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

}  // namespace mtdb::internal
