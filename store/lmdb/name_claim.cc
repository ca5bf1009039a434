// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/name_claim.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <sys/stat.h>
#include <unistd.h>

#include "store/base/hash.h"
#include "store/files/posix_file.h"
#include "store/pages/meta_page.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kGateByte = uint64_t{1} << 61;
constexpr uint64_t kFirstClaimByte = kGateByte + 1;
constexpr uint64_t kEndOfClaims = uint64_t{1} << 62;  // where the builders' locks begin

Status LockError(const StoreFile& file) {
  return IoError(file.path() + ": cannot lock: " + std::strerror(errno) +
                 "; the file system must support locks");
}

struct flock Range(short type, uint64_t first, uint64_t end) {
  struct flock lock {};
  lock.l_type = type;
  lock.l_whence = SEEK_SET;
  lock.l_start = static_cast<off_t>(first);
  lock.l_len = static_cast<off_t>(end - first);
  return lock;
}

// Waits: the gate is held for a few system calls, or as long as the store is compacted.
Status Lock(const StoreFile& file, short type, uint64_t byte) {
  struct flock lock = Range(type, byte, byte + 1);
  while (::fcntl(file.descriptor(), F_OFD_SETLKW, &lock) != 0) {
    if (errno != EINTR) return LockError(file);
  }
  return Status::Ok();
}

Result<bool> AnyLocked(const StoreFile& file, uint64_t first, uint64_t end) {
  if (first == end) return false;
  struct flock lock = Range(F_WRLCK, first, end);
  if (::fcntl(file.descriptor(), F_OFD_GETLK, &lock) != 0) return LockError(file);
  return lock.l_type != F_UNLCK;
}

// The same for all processes of this machine that have this lock file open, in whatever container;
// another one on another machine, where LMDB's lock file has no meaning.
uint64_t ClaimByte(const struct stat& lock_file) {
  std::ifstream in("/proc/sys/kernel/random/boot_id");
  std::string boot;
  in >> boot;
  const uint64_t identity = Mix64(Mix64(Hash64(AsBytes(boot), 0) ^ uint64_t{lock_file.st_dev}) ^
                                  uint64_t{lock_file.st_ino});
  return kFirstClaimByte + identity % (kEndOfClaims - kFirstClaimByte);
}

// What LMDB maps of a lock file for its readers (LmdbEnvironment opens stores for 512 of them, of
// 64 bytes), and some more. LMDB takes from a larger file how many readers there may be.
constexpr off_t kLockFileBytes = 512 * 64 + 4096;

// LMDB maps the lock file and writes to it, which kills the process where the disk has no room for
// its pages: they get it before. Nobody else is in the gate.
Status AllocateLockFile(int descriptor, const std::string& path) {
  struct stat info {};
  struct flock lock = Range(F_WRLCK, 0, 0);  // all of it
  if (::fstat(descriptor, &info) != 0 || ::fcntl(descriptor, F_OFD_GETLK, &lock) != 0) {
    return IoError(path + ": cannot be examined: " + std::strerror(errno));
  }
  // Who has it open has mapped as much as there was.
  const bool alone = lock.l_type == F_UNLCK;
  const off_t bytes = alone ? std::max(info.st_size, kLockFileBytes) : info.st_size;
  int error = 0;
  while (::fallocate(descriptor, 0, 0, bytes) != 0) {
    error = errno;
    if (error != EINTR) break;
    error = 0;
  }
  if (error == EOPNOTSUPP || error == ENOSYS) {
    error = 0;
    if (alone) {
      Bytes content(static_cast<size_t>(bytes));
      const bool written = ReadFully(descriptor, 0, content.data(), content.size()) >= 0 &&
                           WriteFully(descriptor, 0, content.data(), content.size());
      if (!written) error = errno;
    }
  }
  if (error == 0) return Status::Ok();
  const StatusCode code = FileErrorCode(error);
  return {code, path + ": no room for the store's lock file: " + std::strerror(error) +
                    (code == StatusCode::kNoSpace ? "; make room on this disk" : "")};
}

std::string LockPath(const std::string& path) { return path + "-lock"; }

}  // namespace

Result<std::unique_ptr<NameClaim>> NameClaim::Acquire(const std::string& path, bool writable) {
  const auto access = writable ? StoreFile::Access::kReadWrite : StoreFile::Access::kRead;
  MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(path, access));
  const int descriptor =
      TEMP_FAILURE_RETRY(::open(LockPath(path).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (descriptor < 0) {
    return IoError(LockPath(path) + ": cannot open the store's lock file: " + std::strerror(errno));
  }
  std::unique_ptr<NameClaim> claim(new NameClaim(std::move(file), descriptor));
  struct stat info {};
  if (::fstat(descriptor, &info) != 0) {
    return IoError(LockPath(path) + ": cannot stat: " + std::strerror(errno));
  }
  // The gate makes one winner of two that come at the same time.
  const StoreFile& locked = *claim->file_;
  MTDB_RETURN_IF_ERROR(Lock(locked, writable ? F_WRLCK : F_RDLCK, kGateByte));
  const uint64_t own = ClaimByte(info);
  MTDB_ASSIGN_OR_RETURN(const bool below, AnyLocked(locked, kFirstClaimByte, own));
  MTDB_ASSIGN_OR_RETURN(const bool above, AnyLocked(locked, own + 1, kEndOfClaims));
  MTDB_ASSIGN_OR_RETURN(const bool beside, AnyLocked(locked, own, own + 1));
  if (below || above) {
    return Status(
        StatusCode::kBusy,
        path +
            ": another program has this file open by another name (a hard link, a bind mount, "
            "from another machine or container), or its lock file was deleted since: the two "
            "would not see each other's changes; use the same name, or wait for that program");
  }
  // LMDB goes on with an empty file, but not with what is left of one that was being made when its
  // process died or the disk was full. Nobody else has it open.
  if (writable && !beside && !ReadMetaPages(locked).ok() && NeverCommitted(locked) &&
      ::ftruncate(locked.descriptor(), 0) != 0) {
    return IoError(path + ": cannot be emptied: " + std::strerror(errno));
  }
  MTDB_RETURN_IF_ERROR(AllocateLockFile(descriptor, LockPath(path)));
  MTDB_RETURN_IF_ERROR(Lock(locked, F_RDLCK, own));
  MTDB_RETURN_IF_ERROR(Lock(locked, F_UNLCK, kGateByte));
  return claim;
}

Result<std::unique_ptr<NameClaim>> NameClaim::AcquireAlone(const std::string& path) {
  MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(path, StoreFile::Access::kReadWrite));
  std::unique_ptr<NameClaim> claim(new NameClaim(std::move(file), -1));
  const StoreFile& locked = *claim->file_;
  MTDB_RETURN_IF_ERROR(Lock(locked, F_WRLCK, kGateByte));
  struct stat now {};
  if (::stat(path.c_str(), &now) != 0 || now.st_dev != locked.device() ||
      now.st_ino != locked.inode()) {
    return Status(StatusCode::kBusy, path + ": the file was replaced just now; try again");
  }
  struct flock lock = Range(F_WRLCK, kFirstClaimByte, kEndOfClaims);
  if (::fcntl(locked.descriptor(), F_OFD_SETLK, &lock) == 0) return claim;
  if (errno != EAGAIN && errno != EACCES) return LockError(locked);
  return Status(StatusCode::kBusy,
                path +
                    ": another program is writing to the store, copying it or verifying it; "
                    "wait for that program, or stop it");
}

NameClaim::~NameClaim() {
  if (lock_descriptor_ >= 0) ::close(lock_descriptor_);
}

Status NameClaim::CheckLockFile() const {
  struct stat claimed {};
  struct stat now {};
  const std::string lock_path = LockPath(file_->path());
  if (::fstat(lock_descriptor_, &claimed) == 0 && ::stat(lock_path.c_str(), &now) == 0 &&
      claimed.st_dev == now.st_dev && claimed.st_ino == now.st_ino) {
    return Status::Ok();
  }
  return {StatusCode::kBusy,
          lock_path + ": deleted or replaced while the store was opened; try again"};
}

}  // namespace mtdb::internal
