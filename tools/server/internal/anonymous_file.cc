// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/anonymous_file.h"

#include <cerrno>
#include <filesystem>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

#include "store/files/posix_file.h"

namespace mtdb::internal {

namespace {

constexpr const char* kPrefix = "mtdb-unnamed-";

}  // namespace

Result<AnonymousFile> AnonymousFile::Create(const std::string& folder) {
  AnonymousFile file;
  file.descriptor_ = OpenNamelessFile(folder, kPrefix);
  if (file.descriptor_ >= 0) return file;
  const int error = errno;
  std::string message =
      folder + ": no temporary file can be made there: " + std::generic_category().message(error);
  const bool full =
      FileErrorCode(error) == StatusCode::kNoSpace || error == EMFILE || error == ENFILE;
  return full ? Status(StatusCode::kNoSpace, std::move(message)) : IoError(std::move(message));
}

// They have been given no bytes yet, and whoever still has one open loses nothing with its name.
void AnonymousFile::Sweep(const std::string& folder) {
  std::error_code error;
  for (auto at = std::filesystem::directory_iterator(folder, error);
       !error && at != std::filesystem::directory_iterator(); at.increment(error)) {
    const std::string& path = at->path().native();
    struct stat info {};
    if (!at->path().filename().native().starts_with(kPrefix) || ::lstat(path.c_str(), &info) != 0) {
      continue;
    }
    if (S_ISREG(info.st_mode) && info.st_size == 0 && info.st_uid == ::geteuid()) {
      ::unlink(path.c_str());
    }
  }
}

AnonymousFile::~AnonymousFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

uint64_t AnonymousFile::size_bytes() const {
  struct stat info {};
  return ::fstat(descriptor_, &info) == 0 ? static_cast<uint64_t>(info.st_size) : 0;
}

size_t AnonymousFile::ReadAt(uint64_t offset, char* out, size_t size) const {
  while (true) {
    const ssize_t n = ::pread(descriptor_, out, size, static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    return n < 0 ? 0 : static_cast<size_t>(n);
  }
}

}  // namespace mtdb::internal
