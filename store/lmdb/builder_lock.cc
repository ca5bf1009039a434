// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/builder_lock.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>

#include "store/base/hash.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kFirstIdByte = uint64_t{1} << 62;
constexpr uint64_t kFirstNameByte = kFirstIdByte + (uint64_t{1} << 61);

}  // namespace

Result<std::optional<BuilderLock>> BuilderLock::TryAcquire(const std::string& path, ObjectId id) {
  return TryLock(path, kFirstIdByte + id.value);
}

Result<std::optional<BuilderLock>> BuilderLock::TryAcquire(const std::string& path,
                                                           std::string_view name) {
  return TryLock(path, kFirstNameByte + (Hash64(AsBytes(name), 0) >> 3));
}

Result<std::optional<BuilderLock>> BuilderLock::TryLock(const std::string& path, uint64_t place) {
  MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(path, StoreFile::Access::kReadWrite));
  struct flock lock {};
  lock.l_type = F_WRLCK;
  lock.l_whence = SEEK_SET;
  lock.l_start = static_cast<off_t>(place);
  lock.l_len = 1;
  if (::fcntl(file->descriptor(), F_OFD_SETLK, &lock) == 0) {
    return std::optional<BuilderLock>(BuilderLock(std::move(file)));
  }
  if (errno == EAGAIN || errno == EACCES) return std::optional<BuilderLock>();
  return IoError(path + ": cannot lock: " + std::strerror(errno) +
                 "; the file system must support locks");
}

}  // namespace mtdb::internal
