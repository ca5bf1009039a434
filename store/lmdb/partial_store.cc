// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/partial_store.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <sys/stat.h>
#include <unistd.h>

#include "store/files/guarded_file.h"
#include "store/files/posix_file.h"
#include "store/lmdb/sync_folder.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kPartialByte = uint64_t{1} << 60;
constexpr int kTries = 100;

Status Failure(const std::string& path, const char* doing) {
  const int error = errno;
  return {FileErrorCode(error), path + ": " + doing + ": " + std::strerror(error)};
}

// Files that are being written have this bit of their mode, which means nothing for files and is
// taken away with Commit(): so what a process that died has left is told from a store that somebody
// has given such a name.
constexpr mode_t kUnfinished = S_ISVTX;

// What has the name is a file of no more names, empty or left by a process that died.
Status CheckLeftOver(const StoreFile& file) {
  struct stat named {
  }, opened{};
  if (::lstat(file.path().c_str(), &named) != 0) return Status::Ok();  // the caller tries again
  if (::fstat(file.descriptor(), &opened) != 0) return Failure(file.path(), "cannot stat");
  const bool own = (opened.st_mode & kUnfinished) != 0 || opened.st_size == 0;
  if (own && S_ISREG(named.st_mode) && opened.st_nlink <= 1) return Status::Ok();
  return {StatusCode::kAlreadyExists,
          file.path() +
              ": the new store is written under this name before it gets its own, but "
              "something else has it; nothing was written: remove that file, or give "
              "it another name"};
}

void RemoveLockFile(const std::string& store) { (void)::unlink((store + "-lock").c_str()); }

}  // namespace

Result<std::unique_ptr<PartialStore>> PartialStore::Create(const std::string& path) {
  const std::string partial = path + ".partial";
  std::error_code error;
  const auto folder = std::filesystem::path(path).parent_path();
  if (!folder.empty() && !std::filesystem::is_directory(folder, error)) {
    return NotFound(path + ": " + folder.string() + " is not a folder; make it first");
  }
  if (!std::filesystem::path(path).has_filename()) {
    return InvalidArgument(path + ": is a folder; give the name of a file in it");
  }
  for (int i = 0; i < kTries; ++i) {
    MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(partial, StoreFile::Access::kCreate));
    struct flock lock {};
    lock.l_type = F_WRLCK;
    lock.l_whence = SEEK_SET;
    lock.l_start = static_cast<off_t>(kPartialByte);
    lock.l_len = 1;
    if (::fcntl(file->descriptor(), F_OFD_SETLK, &lock) != 0) {
      if (errno != EAGAIN && errno != EACCES) return Failure(partial, "cannot be locked");
      return Status(StatusCode::kBusy,
                    partial + ": another program is just writing it; wait for that, or stop it");
    }
    // Whoever had the lock before may have given the file its name.
    struct stat now {};
    if (::stat(partial.c_str(), &now) != 0 || now.st_dev != file->device() ||
        now.st_ino != file->inode()) {
      continue;
    }
    MTDB_RETURN_IF_ERROR(CheckLeftOver(*file));
    (void)::fchmod(file->descriptor(), (now.st_mode & 07777) | kUnfinished);
    RemoveLockFile(partial);
    // From here on an error removes the file.
    std::unique_ptr<PartialStore> made(new PartialStore(path, partial, std::move(file)));
    if (::ftruncate(made->file_->descriptor(), 0) != 0) {
      return Failure(partial, "cannot be emptied");
    }
    return made;
  }
  return Status(StatusCode::kBusy, partial + ": other programs write it again and again");
}

PartialStore::~PartialStore() {
  if (committed_) return;
  RemoveLockFile(partial_);
  (void)::unlink(partial_.c_str());
}

Status PartialStore::AdoptPermissions(const StoreFile& other) {
  struct stat info {};
  if (::fstat(other.descriptor(), &info) != 0) return Failure(other.path(), "cannot stat");
  // Only root may give files away; to whom the group cannot be given, the owner's is left.
  (void)!::fchown(file_->descriptor(), info.st_uid, info.st_gid);
  if (::fchmod(file_->descriptor(), (info.st_mode & 07777) | kUnfinished) != 0) {
    return Failure(partial_, "cannot get the permissions of the store");
  }
  return Status::Ok();
}

Status PartialStore::Commit(bool replace) {
  if (::fsync(file_->descriptor()) != 0) return Failure(partial_, "cannot be written to the disk");
  RemoveLockFile(partial_);
  int result = 0;
  if (replace) {
    result = std::rename(partial_.c_str(), path_.c_str());
  } else {
    result = ::renameat2(AT_FDCWD, partial_.c_str(), AT_FDCWD, path_.c_str(), RENAME_NOREPLACE);
    if (result != 0 && (errno == EINVAL || errno == ENOSYS)) {  // a file system without it
      result = ::link(partial_.c_str(), path_.c_str());
      if (result == 0) (void)::unlink(partial_.c_str());
    }
  }
  if (result != 0) {
    if (errno == EEXIST) {
      return {StatusCode::kAlreadyExists, path_ + ": was made by somebody else meanwhile"};
    }
    return Failure(path_, "cannot be given its name");
  }
  committed_ = true;
  struct stat info {};
  if (::fstat(file_->descriptor(), &info) == 0) {
    (void)::fchmod(file_->descriptor(), info.st_mode & 07777 & ~kUnfinished);
  }
  return SyncFolder(path_);
}

}  // namespace mtdb::internal
