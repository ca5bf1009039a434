// Environment: the one LMDB environment of a store file in this process. LMDB pins snapshots and
// writes; reading goes through PageReader. Start with BeginRead() and Write().
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/database.h"
#include "store/internal/catalog_entry.h"
#include "store/internal/keys.h"
#include "store/internal/name_claim.h"
#include "store/internal/page_reader.h"
#include "store/internal/snapshot_state.h"
#include "store/internal/store_file.h"

struct MDB_env;
struct MDB_txn;

namespace mtdb {

class Environment;

// A pinned snapshot: as long as it lives, its pages stay. Keep it short: pages freed meanwhile
// cannot be used again. Move-only; one thread at a time.
class Snapshot {
 public:
  Snapshot(Snapshot&& other) noexcept;
  Snapshot& operator=(Snapshot&&) = delete;
  ~Snapshot();

  PageReader& pages() const { return state_->pages; }
  uint64_t txnid() const { return state_->pages.meta().txnid; }
  Result<std::optional<ValueRef>> Find(Table table, ByteSpan key) const;
  // Calls `visit` with the keys of the table from `first` on, ascending, until it answers false.
  Status Scan(Table table, ByteSpan first, const PageReader::Visitor& visit) const;
  const Superblock& superblock() const { return state_->superblock; }

 private:
  friend class Environment;
  Snapshot(std::shared_lock<std::shared_mutex> lock, MDB_txn* txn,
           std::shared_ptr<SnapshotState> state);

  std::shared_lock<std::shared_mutex> lock_;
  MDB_txn* txn_ = nullptr;
  std::shared_ptr<SnapshotState> state_;
};

// A write transaction, for the time of one Environment::Write.
class WriteTransaction {
 public:
  // Bytes stay valid until the next Put or Delete.
  Result<std::optional<ByteSpan>> Get(Table table, ByteSpan key);
  Status Put(Table table, ByteSpan key, ByteSpan value);
  // kNotFound when the key is not there.
  Status Delete(Table table, ByteSpan key);
  // Deletes keys that begin with `prefix` until `max_keys` of them or `max_bytes` of values are
  // gone; true when none is left.
  Result<bool> DeletePrefix(Table table, ByteSpan prefix, uint64_t max_keys, uint64_t max_bytes);
  // Calls `visit` with the keys from `first` on, ascending, until it answers false.
  using Visitor = std::function<Result<bool>(ByteSpan key, ByteSpan value)>;
  Status Scan(Table table, ByteSpan first, const Visitor& visit);

  // The sealed value's body.
  Result<std::optional<Bytes>> GetSealed(Table table, ByteSpan key);
  Status PutSealed(Table table, ByteSpan key, ByteSpan body);

  // Written back when the transaction commits.
  Superblock& superblock() { return superblock_; }

 private:
  friend class Environment;
  WriteTransaction(const Environment* environment, MDB_txn* txn, unsigned tree)
      : environment_(environment), txn_(txn), tree_(tree) {}

  Status Fail(int lmdb_error);

  const Environment* environment_;
  MDB_txn* txn_;
  unsigned tree_;  // LMDB's handle
  Superblock superblock_;
  int lmdb_error_ = 0;
};

// Safe for many threads.
class Environment {
 public:
  // The process's environment of the file at `path`; opens it when it is the first.
  static Result<std::shared_ptr<Environment>> Open(const std::string& path,
                                                   const OpenOptions& options);

  const std::string& path() const { return file_->path(); }
  // The file's own, with no symbolic link in it.
  const std::string& real_path() const { return real_path_; }
  const StoreFile& file() const { return *file_; }
  uint32_t page_size() const { return page_size_; }
  bool writable() const;

  // The newest snapshot. `fresh`: without the pages that earlier ones have read.
  Result<Snapshot> BeginRead(bool fresh = false);

  // Runs `body` in a write transaction and commits it, unless it returns an error. May run `body`
  // again from the start when the map had to grow. Not to be called from within `body`, nor while
  // the thread holds a Snapshot.
  Status Write(const std::function<Status(WriteTransaction&)>& body);

 private:
  friend class WriteTransaction;
  Environment(std::unique_ptr<StoreFile> file, std::string real_path);
  ~Environment();

  // Whether the first of those who asked for it succeeded; waits for that one.
  bool opened() const;
  Status OpenLmdb(bool writable, uint64_t map_at_least, bool check_pages);
  Status CheckPinnedPages();
  void CloseLmdb();
  Status MakeWritable();
  Status CheckBeforeOpen(bool may_be_empty);
  Status Reopen();
  Status AdoptMapSize();
  Status GrowMap();
  Status Remap(uint64_t at_least);
  Status TryWrite(const std::function<Status(WriteTransaction&)>& body, int* lmdb_error);
  Result<std::shared_ptr<SnapshotState>> StateOf(uint64_t txnid, bool fresh);
  // An error of LMDB as a Status; `doing` says what failed.
  Status Error(int lmdb_error, const std::string& doing) const;

  std::unique_ptr<StoreFile> file_;
  const std::string real_path_;
  // Held shared by every transaction; exclusive while the environment is opened or remapped.
  mutable std::shared_mutex mutex_;
  bool opened_ = false;
  std::unique_ptr<NameClaim> name_claim_;  // held while LMDB has the file open
  bool name_claim_writable_ = false;
  MDB_env* env_ = nullptr;
  bool writable_ = false;
  uint64_t map_size_ = 0;
  uint32_t page_size_ = 0;
  std::mutex state_mutex_;  // guards state_
  std::shared_ptr<SnapshotState> state_;

  struct Registry;
  static Registry& GetRegistry();
};

}  // namespace mtdb
