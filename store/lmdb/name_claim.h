// SPDX-License-Identifier: Apache-2.0
// NameClaim: keeps a store file from being opened by LMDB under two names. LMDB's lock file lies
// beside the name that a store is opened by, so programs that use two names (hard links, bind
// mounts, containers), or that began before and after the lock file was deleted, would not see each
// other. See store/FORMAT.md, "Who locks what".
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "store/carriers/store_file.h"

namespace mtdb::internal {

// Held as long as LMDB has the store open. The operating system drops it when its holder dies.
class NameClaim {
 public:
  // `path` is the store file's own, with no symbolic link in it; the lock file beside it is made
  // when it is not there. `writable`: the store file can be opened for writing. Errors: kBusy when
  // somebody has the store open by another lock file, kIoError.
  static Result<std::unique_ptr<NameClaim>> Acquire(const std::string& path, bool writable);
  // That nobody else has the store open with LMDB, nor opens it as long as this lives: who comes
  // meanwhile waits. kBusy when somebody has it open.
  static Result<std::unique_ptr<NameClaim>> AcquireAlone(const std::string& path);
  ~NameClaim();
  NameClaim(const NameClaim&) = delete;
  NameClaim& operator=(const NameClaim&) = delete;

  // kBusy when the lock file at the path is no longer the one that was claimed, as when somebody
  // deleted it just before LMDB opened it.
  Status CheckLockFile() const;
  const StoreFile& file() const { return *file_; }

 private:
  NameClaim(std::unique_ptr<StoreFile> file, int lock_descriptor)
      : file_(std::move(file)), lock_descriptor_(lock_descriptor) {}

  std::unique_ptr<StoreFile> file_;  // an open file description of its own; closing it unlocks
  int lock_descriptor_ = -1;  // keeps the lock file's inode number from being given to another
};

}  // namespace mtdb::internal
