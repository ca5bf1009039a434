#include "tools/server/internal/anonymous_file.h"

#include <cerrno>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

namespace mtdb::internal {

namespace {

constexpr const char* kPrefix = "mtdb-unnamed-";

// A name, and at once none.
int CreateAndUnlink(const std::string& folder) {
  std::string path = folder + "/" + kPrefix + "XXXXXX";
  const int descriptor = ::mkostemp(path.data(), O_CLOEXEC);
  const int error = errno;
  if (descriptor >= 0) ::unlink(path.c_str());
  errno = error;
  return descriptor;
}

}  // namespace

Result<AnonymousFile> AnonymousFile::Create(const std::string& folder) {
  AnonymousFile file;
#ifdef O_TMPFILE
  file.descriptor_ =
      TEMP_FAILURE_RETRY(::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600));
#endif
  if (file.descriptor_ < 0) file.descriptor_ = CreateAndUnlink(folder);
  if (file.descriptor_ >= 0) return file;
  const int error = errno;
  std::string message =
      folder + ": no temporary file can be made there: " + std::generic_category().message(error);
  const bool full = error == ENOSPC || error == EDQUOT || error == EMFILE || error == ENFILE;
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
