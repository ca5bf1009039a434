#include "codecs/raster_file/internal/file.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace mtdb::internal {

Result<RasterInput> RasterInput::Open(const std::string& path) {
  RasterInput file;
  file.path_ = path;
  file.descriptor_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
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
      size_(other.size_) {}

RasterInput& RasterInput::operator=(RasterInput&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(descriptor_, other.descriptor_);
  std::swap(size_, other.size_);
  return *this;
}

RasterInput::~RasterInput() {
  if (descriptor_ >= 0) close(descriptor_);
}

Status RasterInput::Read(uint64_t offset, void* to, size_t bytes) const {
  auto* at = static_cast<char*>(to);
  size_t done = 0;
  while (done < bytes) {
    const ssize_t n =
        pread(descriptor_, at + done, bytes - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return IoError(path_ + ": " + std::strerror(errno));
    if (n == 0) {
      return BadInput(path_ + ": ends at byte " + std::to_string(offset + done) + ", expected " +
                      std::to_string(bytes - done) + " more");
    }
    done += static_cast<size_t>(n);
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
