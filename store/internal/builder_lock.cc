#include "store/internal/builder_lock.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>

namespace mtdb {
namespace {

constexpr int64_t kFirstLockByte = int64_t{1} << 62;

}  // namespace

Result<std::optional<BuilderLock>> BuilderLock::TryAcquire(const std::string& path, ObjectId id) {
  MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(path, StoreFile::Access::kReadWrite));
  struct flock lock {};
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  lock.l_start = static_cast<off_t>(kFirstLockByte + static_cast<int64_t>(id.value));
  lock.l_len = 1;
  if (::fcntl(file->descriptor(), F_OFD_SETLK, &lock) == 0) {
    return std::optional<BuilderLock>(BuilderLock(std::move(file)));
  }
  if (errno == EAGAIN || errno == EACCES) return std::optional<BuilderLock>();
  return IoError(path + ": cannot lock: " + std::strerror(errno) +
                 "; the file system must support locks");
}

}  // namespace mtdb
