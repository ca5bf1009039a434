// SPDX-License-Identifier: Apache-2.0
// Environment: a store file in this process. Reads snapshots through PageReader, with neither LMDB
// nor a lock, and writes through LmdbEnvironment. Start with Read() and Write().
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <string>
#include <type_traits>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/carriers/store_file.h"
#include "store/lmdb/lmdb_environment.h"
#include "store/open_options.h"
#include "store/pages/page_reader.h"
#include "store/pages/snapshot_state.h"
#include "store/records/keys.h"

namespace mtdb::internal {

// What the newest transaction of its time left behind. Unless it is pinned, a writer uses its pages
// again once two later transactions are committed, so what was read counts only if
// Environment::Holds() says so afterwards, or if it proves itself (store/FORMAT.md, "Reading beside
// a writer"). Cheap to move; one thread at a time. Must not outlive its Environment.
class Snapshot {
 public:
  PageReader& pages() const { return state_->pages; }
  const SnapshotState& state() const { return *state_; }
  Result<std::optional<ValueRef>> Find(Table table, ByteSpan key) const;
  // Calls `visit` with the keys of the table from `first` on, ascending, until it answers false.
  Status Scan(Table table, ByteSpan first, const PageReader::Visitor& visit) const;
  // What the free database lists, of the pages within the file.
  Result<uint64_t> CountFreeBytes() const;
  const Superblock& superblock() const { return state_->superblock; }
  bool pinned() const { return pin_ != nullptr; }

 private:
  friend class Environment;
  std::shared_ptr<SnapshotState> state_;
  std::shared_ptr<Pin> pin_;
};

// Safe for many threads.
class Environment {
 public:
  // The process's environment of the file at `path`; opens it when it is the first.
  static Result<std::shared_ptr<Environment>> Open(const std::string& path,
                                                   const OpenOptions& options);

  const std::string& path() const { return file_->path(); }
  // The file's own, with no symbolic link in it.
  const std::string& real_path() const { return lmdb_.real_path(); }
  const StoreFile& file() const { return *file_; }
  uint32_t page_size() const { return lmdb_.page_size(); }
  bool writable() const { return lmdb_.writable(); }

  // The newest snapshot. `fresh`: without the pages that earlier ones have read.
  Result<Snapshot> Newest(bool fresh = false);
  // The same, pinned where it can be: not for somebody who may not write the lock file.
  Result<Snapshot> NewestPinned();
  // Whether all that was read from the snapshot so far was its own. An error when the file is no
  // store any more.
  Result<bool> Holds(const Snapshot& snapshot) const;

  // Calls `read` with the newest snapshot, and again with a newer one when a writer took its pages
  // away meanwhile. kBusy when that happens again and again. `read` returns a Status or Result.
  template <typename Function>
  auto Read(const Function& read) -> std::invoke_result_t<Function, const Snapshot&> {
    return ReadUntilHeld(read, false);
  }
  // The same for what proves itself by its checksum: a success counts in any case.
  template <typename Function>
  auto ReadProven(const Function& read) -> std::invoke_result_t<Function, const Snapshot&> {
    return ReadUntilHeld(read, true);
  }

  // See LmdbEnvironment::Write.
  Status Write(const std::function<Status(WriteTransaction&)>& body) { return lmdb_.Write(body); }

 private:
  explicit Environment(std::unique_ptr<StoreFile> file);
  static Result<std::shared_ptr<Environment>> TryOpen(std::unique_ptr<StoreFile> file,
                                                      const OpenOptions& options);
  // Whether the first of those who asked for it succeeded; waits for that one.
  bool opened() const;
  Status OpenFirst(const OpenOptions& options);
  Status Busy() const;

  template <typename Function>
  auto ReadUntilHeld(const Function& read, bool proven)
      -> std::invoke_result_t<Function, const Snapshot&> {
    for (int i = 0; i < kTries; ++i) {
      MTDB_ASSIGN_OR_RETURN(const Snapshot snapshot, Newest(true));
      auto result = read(snapshot);
      if (proven && result.ok()) return result;
      MTDB_ASSIGN_OR_RETURN(const bool held, Holds(snapshot));
      if (held) return result;
    }
    return Busy();
  }

  static constexpr int kTries = 200;

  std::unique_ptr<StoreFile> file_;
  LmdbEnvironment lmdb_;
  mutable std::shared_mutex opening_;  // held exclusively by the first that opens it
  bool opened_ = false;
  bool registered_ = false;  // the registry leads to it; guarded by the registry's mutex
  std::mutex state_mutex_;   // guards state_
  std::shared_ptr<SnapshotState> state_;

  struct Registry;
  static Registry& GetRegistry();
};

}  // namespace mtdb::internal
