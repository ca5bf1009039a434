// SPDX-License-Identifier: Apache-2.0
#include "store/carriers/store_file.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "store/files/posix_file.h"

namespace mtdb::internal {

StoreFile::StoreFile(std::string path, int descriptor)
    : path_(std::move(path)), descriptor_(descriptor) {}

StoreFile::~StoreFile() { ::close(descriptor_); }

Result<std::unique_ptr<StoreFile>> StoreFile::Open(const std::string& path, Access access) {
  int flags = O_CLOEXEC | O_NONBLOCK;  // a pipe must not make us wait
  if (access == Access::kRead) flags |= O_RDONLY;
  if (access == Access::kReadWrite) flags |= O_RDWR;
  if (access == Access::kCreate) flags |= O_RDWR | O_CREAT;
  const int descriptor = TEMP_FAILURE_RETRY(::open(path.c_str(), flags, 0644));
  if (descriptor < 0) {
    if (errno == ENOENT) {
      return NotFound(path + ": no such file" +
                      (access == Access::kCreate ? " or directory" : "; check the store's path"));
    }
    return IoError(path + ": cannot open: " + std::strerror(errno));
  }
  std::unique_ptr<StoreFile> file(new StoreFile(path, descriptor));
  struct stat info {};
  if (::fstat(descriptor, &info) != 0) {
    return IoError(path + ": cannot stat: " + std::strerror(errno));
  }
  if (!S_ISREG(info.st_mode)) {
    return InvalidArgument(path + ": not a regular file; a store is one file");
  }
  file->device_ = info.st_dev;
  file->inode_ = info.st_ino;
  return file;
}

Result<uint64_t> StoreFile::Size() const {
  struct stat info {};
  if (::fstat(descriptor_, &info) != 0) {
    return IoError(path_ + ": cannot stat: " + std::strerror(errno));
  }
  return static_cast<uint64_t>(info.st_size);
}

Status StoreFile::ReadAt(uint64_t offset, std::span<std::byte> out) const {
  const ssize_t n = ReadFully(descriptor_, offset, out.data(), out.size());
  if (n < 0) {
    return IoError(path_ + ": offset " + std::to_string(offset) +
                   ": cannot read: " + std::strerror(errno));
  }
  if (const uint64_t end = offset + static_cast<uint64_t>(n); end < offset + out.size()) {
    return Corrupt(path_ + ": the file ends at byte " + std::to_string(end) + ", but " +
                   std::to_string(out.size()) + " bytes were expected at " +
                   std::to_string(offset) + "; it was truncated: restore it from a copy");
  }
  bytes_read_.fetch_add(out.size(), std::memory_order_relaxed);
  return Status::Ok();
}

}  // namespace mtdb::internal
