// SPDX-License-Identifier: Apache-2.0
#include "codecs/raster_file/internal/file.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "store/files/posix_file.h"

namespace mtdb::internal {

Result<RasterInput> RasterInput::Open(const std::string& path) {
  RasterInput file;
  file.path_ = path;
  file.descriptor_ = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // pipes are no files
  struct stat status {};
  if (file.descriptor_ < 0 || fstat(file.descriptor_, &status) != 0) {
    const int error = errno;
    const std::string message = path + ": " + std::strerror(error);
    return Status(error == ENOENT ? StatusCode::kNotFound : StatusCode::kIoError, message);
  }
  if (!S_ISREG(status.st_mode)) return BadInput(path + ": expected a file, found none");
  file.size_ = static_cast<uint64_t>(status.st_size);
  return file;
}

RasterInput::RasterInput(RasterInput&& other) noexcept
    : path_(std::move(other.path_)),
      descriptor_(std::exchange(other.descriptor_, -1)),
      size_(other.size_),
      front_(other.front_) {}

RasterInput& RasterInput::operator=(RasterInput&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(descriptor_, other.descriptor_);
  std::swap(size_, other.size_);
  std::swap(front_, other.front_);
  return *this;
}

RasterInput::~RasterInput() {
  if (descriptor_ >= 0) close(descriptor_);
}

Status RasterInput::Read(uint64_t offset, void* to, size_t bytes) const {
  const ssize_t n = ReadFully(descriptor_, front_ + offset, to, bytes);
  if (n < 0) return IoError(path_ + ": " + std::strerror(errno));
  const auto done = static_cast<size_t>(n);
  if (done < bytes) {
    return BadInput(path_ + ": ends at byte " + std::to_string(offset + done) + ", expected " +
                    std::to_string(bytes - done) + " more");
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
