// SPDX-License-Identifier: Apache-2.0
// LmdbEnvironment: LMDB on a store file, for whoever writes it, and for pins. Reading does not need
// it.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <shared_mutex>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/carriers/store_file.h"
#include "store/lmdb/name_claim.h"
#include "store/pages/catalog_entry.h"
#include "store/pages/page.h"
#include "store/records/keys.h"

struct MDB_env;
struct MDB_txn;

namespace mtdb::internal {

class LmdbEnvironment;

// A write transaction, for the time of one LmdbEnvironment::Write.
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
  friend class LmdbEnvironment;
  WriteTransaction(const LmdbEnvironment* environment, MDB_txn* txn, unsigned tree)
      : environment_(environment), txn_(txn), tree_(tree) {}

  Status Fail(int lmdb_error);

  const LmdbEnvironment* environment_;
  MDB_txn* txn_;
  unsigned tree_;  // LMDB's handle
  Superblock superblock_;
  int lmdb_error_ = 0;
};

// As long as it lives, no writer uses a page again that the newest snapshot of its beginning, or a
// later one, reaches. Any thread may destroy it.
class Pin {
 public:
  Pin(Pin&& other) noexcept;
  Pin& operator=(Pin&&) = delete;
  ~Pin();

 private:
  friend class LmdbEnvironment;
  Pin(LmdbEnvironment* environment, std::shared_lock<std::shared_mutex> lock, MDB_txn* txn)
      : environment_(environment), lock_(std::move(lock)), txn_(txn) {}

  LmdbEnvironment* environment_;
  std::shared_lock<std::shared_mutex> lock_;
  MDB_txn* txn_;
};

// Safe for many threads. One per store file and process. Opens LMDB when it is first needed.
class LmdbEnvironment {
 public:
  // `file` must outlive it.
  explicit LmdbEnvironment(const StoreFile* file);
  ~LmdbEnvironment();
  LmdbEnvironment(const LmdbEnvironment&) = delete;
  LmdbEnvironment& operator=(const LmdbEnvironment&) = delete;

  bool writable() const;
  // Checks the file, then opens it for writing, unless that is done. An empty file becomes a store
  // if it `may_be_empty`.
  Status MakeWritable(bool may_be_empty);
  // The file's own path, with no symbolic link in it.
  const std::string& real_path() const { return real_path_; }
  uint32_t page_size() const { return page_size_; }

  // Runs `body` in a write transaction and commits it, unless it returns an error. May run `body`
  // again from the start when the map had to grow. Not to be called from within `body`, nor while
  // the thread holds a Pin.
  Status Write(const std::function<Status(WriteTransaction&)>& body);

  // Fails where the lock file cannot be written, or somebody has the store open by another name.
  Result<Pin> PinNewest();

 private:
  friend class WriteTransaction;
  friend class Pin;

  Status OpenLmdb(bool writable, uint64_t map_at_least, bool check_pages);
  Status TryOpenLmdb(bool writable, uint64_t map_at_least, bool check_pages);
  Status CheckPinnedPages();
  void CloseLmdb();
  void CloseAfterPins();
  Status CheckUsable();
  Status CheckBeforeOpen(bool may_be_empty);
  Status Reopen();
  Status AdoptMapSize();
  Status GrowMap();
  Status Remap(uint64_t at_least);
  // A meta page as it was before a transaction that would have replaced it.
  struct OldMetaPage {
    uint64_t offset = 0;
    std::array<std::byte, kPageHeaderBytes + kMetaBytes> bytes{};
  };
  // `superseded` is set when the commit failed.
  Status TryWrite(const std::function<Status(WriteTransaction&)>& body, int* lmdb_error,
                  std::optional<OldMetaPage>* superseded);
  void RestoreMetaPage(const OldMetaPage& old);
  Status Fill(WriteTransaction& write, bool first,
              const std::function<Status(WriteTransaction&)>& body);
  // That the path leads to the file still; its size.
  Status CheckPath(uint64_t* bytes) const;
  // And that the file did not get shorter.
  Status CheckSameFile();
  // An error of LMDB as a Status; `doing` says what failed.
  Status Error(int lmdb_error, const std::string& doing) const;

  const StoreFile* const file_;
  const std::string real_path_;
  // Held shared by every transaction; exclusive while LMDB is opened or remapped.
  mutable std::shared_mutex mutex_;
  MDB_env* env_ = nullptr;
  bool writable_ = false;
  std::unique_ptr<NameClaim> name_claim_;  // held while LMDB has the file open
  bool name_claim_writable_ = false;
  uint64_t map_size_ = 0;
  std::atomic<uint64_t> largest_bytes_{0};  // that the file was seen to have
  uint32_t page_size_ = 0;
  int process_ = 0;  // that opened LMDB: a forked child must not use it
};

}  // namespace mtdb::internal
