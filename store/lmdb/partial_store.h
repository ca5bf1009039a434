// SPDX-License-Identifier: Apache-2.0
// PartialStore: a store file that is being written as a whole, beside the path that it will get.
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "store/carriers/store_file.h"

namespace mtdb::internal {

// Locked while its process lives, so that nobody else writes to it or takes it for a dead one's.
// Without Commit() the file is removed. One thread.
class PartialStore {
 public:
  // Makes "PATH.partial" empty, also when a process that died has left one. kBusy when it is in
  // use.
  static Result<std::unique_ptr<PartialStore>> Create(const std::string& path);
  ~PartialStore();
  PartialStore(const PartialStore&) = delete;
  PartialStore& operator=(const PartialStore&) = delete;

  const std::string& partial_path() const { return partial_; }
  // Gives the file permissions and, where it may, owner and group of `other`.
  Status AdoptPermissions(const StoreFile& other);
  // Gives the file its path, after everything that was written to it has reached the disk. Nobody
  // may have it open by LMDB any more. kAlreadyExists when `replace` is false and the path is
  // there.
  Status Commit(bool replace);

 private:
  PartialStore(std::string path, std::string partial, std::unique_ptr<StoreFile> file)
      : path_(std::move(path)), partial_(std::move(partial)), file_(std::move(file)) {}
  const std::string path_;
  const std::string partial_;
  std::unique_ptr<StoreFile> file_;  // holds the lock
  bool committed_ = false;
};

}  // namespace mtdb::internal
