// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/lmdb_environment.h"

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <lmdb.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include <utility>

#include "store/base/out_of_memory.h"
#include "store/lmdb/sync_folder.h"
#include "store/pages/page_walker.h"
#include "store/pages/store_check.h"

namespace mtdb::internal {
namespace {

static_assert(sizeof(void*) == 8, "a store is mapped as a whole: 64-bit machines only");
static_assert(sizeof(MDB_dbi) == sizeof(unsigned));

constexpr uint64_t kMapReserve = uint64_t{1} << 40;   // address space, not memory
constexpr uint64_t kMapSmallest = uint64_t{1} << 24;  // when the system gives no more
constexpr uint64_t kLowDisk = uint64_t{1} << 26;
constexpr unsigned kReaders = 512;
constexpr int kTries = 100;

MDB_val ToVal(ByteSpan b) {
  return {b.size(), const_cast<void*>(static_cast<const void*>(b.data()))};
}

// Without symbolic links, so that programs that open a file through different ones use one lock
// file. Empty when it cannot be found.
std::string RealPath(const StoreFile& file) {
  const std::unique_ptr<char, decltype(&std::free)> real(::realpath(file.path().c_str(), nullptr),
                                                         &std::free);
  return real == nullptr ? std::string() : std::string(real.get());
}

// Ends with the scope, whatever happens: an abandoned writer would keep all others waiting.
class Transaction {
 public:
  explicit Transaction(MDB_txn* txn) : txn_(txn) {}
  ~Transaction() {
    if (txn_ != nullptr) mdb_txn_abort(txn_);
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  int Commit() { return mdb_txn_commit(std::exchange(txn_, nullptr)); }

 private:
  MDB_txn* txn_;
};

ByteSpan FromVal(const MDB_val& v) { return {static_cast<const std::byte*>(v.mv_data), v.mv_size}; }

}  // namespace

// ---- opening ------------------------------------------------------------------------------------

LmdbEnvironment::LmdbEnvironment(const StoreFile* file)
    : file_(file), real_path_(RealPath(*file)) {}

LmdbEnvironment::~LmdbEnvironment() { CloseLmdb(); }

bool LmdbEnvironment::writable() const {
  const std::shared_lock lock(mutex_);
  return writable_;
}

// LMDB reads and writes a file through its path and a map, which is deadly when the file gets
// shorter, and in vain when the path leads elsewhere. This is looked at before each transaction and
// before each commit.
Status LmdbEnvironment::CheckPath(uint64_t* bytes) const {
  struct stat info {};
  if (::stat(real_path_.c_str(), &info) != 0 || info.st_dev != file_->device() ||
      info.st_ino != file_->inode()) {
    return {StatusCode::kBusy,
            file_->path() +
                ": the file was replaced or deleted while it was open, and what is "
                "written now would be lost; close it first"};
  }
  *bytes = static_cast<uint64_t>(info.st_size);
  return Status::Ok();
}

Status LmdbEnvironment::CheckSameFile() {
  uint64_t bytes = 0;
  MTDB_RETURN_IF_ERROR(CheckPath(&bytes));
  uint64_t largest = largest_bytes_;
  while (largest < bytes && !largest_bytes_.compare_exchange_weak(largest, bytes)) {
  }
  if (bytes >= largest) return Status::Ok();
  return Corrupt(file_->path() + ": the file has " + std::to_string(bytes) + " bytes, but had " +
                 std::to_string(largest) +
                 " since it was opened: it was truncated or written over; close it, and restore it "
                 "from a copy");
}

Status LmdbEnvironment::CheckBeforeOpen(bool may_be_empty) {
  if (may_be_empty && NeverCommitted(*file_)) return Status::Ok();
  return CheckStoreFile(*file_);
}

Status LmdbEnvironment::OpenLmdb(bool writable, uint64_t map_at_least, bool check_pages) {
  const Status status =
      CatchOutOfMemory([&] { return TryOpenLmdb(writable, map_at_least, check_pages); });
  if (!status.ok()) CloseLmdb();
  return status;
}

Status LmdbEnvironment::TryOpenLmdb(bool writable, uint64_t map_at_least, bool check_pages) {
  uint64_t smallest = kMapSmallest;
  MTDB_ASSIGN_OR_RETURN(const uint64_t bytes, file_->Size());
  while (smallest < bytes || smallest < map_at_least) smallest *= 2;
  if (name_claim_ == nullptr || name_claim_writable_ != writable ||
      !name_claim_->CheckLockFile().ok()) {
    name_claim_.reset();
    MTDB_ASSIGN_OR_RETURN(name_claim_, NameClaim::Acquire(real_path_, writable));
    name_claim_writable_ = writable;
    // The claim may have waited until the store was compacted.
    uint64_t now = 0;
    MTDB_RETURN_IF_ERROR(CheckPath(&now));
  }
  int rc = 0;
  for (uint64_t size = std::max(kMapReserve, smallest); size >= smallest; size /= 2) {
    rc = mdb_env_create(&env_);
    if (rc != 0) return Error(rc, "preparing LMDB");
    map_size_ = size;
    mdb_env_set_mapsize(env_, size);
    mdb_env_set_maxreaders(env_, kReaders);
    unsigned flags = MDB_NOSUBDIR | MDB_NOTLS;
    if (!writable) flags |= MDB_RDONLY;
    rc = mdb_env_open(env_, real_path_.c_str(), flags, 0644);
    if (rc == 0) break;
    mdb_env_close(env_);
    env_ = nullptr;
    if (rc == EINTR) size *= 2;  // once more
    if (rc != ENOMEM && rc != EINTR) break;
  }
  if (rc != 0) return Error(rc, "opening the store");
  process_ = ::getpid();
  MTDB_RETURN_IF_ERROR(name_claim_->CheckLockFile());
  MDB_stat stat;
  mdb_env_stat(env_, &stat);
  page_size_ = stat.ms_psize;
  int stale = 0;
  mdb_reader_check(env_, &stale);
  if (writable) {
    if (check_pages) MTDB_RETURN_IF_ERROR(CheckPinnedPages());
    MTDB_RETURN_IF_ERROR(SyncFolder(real_path_));
  }
  writable_ = writable;
  return Status::Ok();
}

// The tree pages are checked once, under a pinned snapshot, before LMDB's writer trusts them.
Status LmdbEnvironment::CheckPinnedPages() {
  MDB_txn* txn = nullptr;
  const int rc = mdb_txn_begin(env_, nullptr, MDB_RDONLY, &txn);
  if (rc != 0) return Error(rc, "reading");
  const Transaction pin(txn);
  MTDB_ASSIGN_OR_RETURN(const MetaPage meta, ReadMetaPageOf(*file_, mdb_txn_id(txn), page_size_));
  MTDB_ASSIGN_OR_RETURN(const auto state, LoadSnapshotState(*file_, meta));
  return CheckTreePages(state->pages);
}

void LmdbEnvironment::CloseLmdb() {
  if (env_ != nullptr) mdb_env_close(env_);
  env_ = nullptr;
}

Status LmdbEnvironment::MakeWritable(bool may_be_empty) {
  const std::unique_lock lock(mutex_);
  if (writable_) return Status::Ok();
  if (real_path_.empty()) {
    return IoError(file_->path() + ": its real path cannot be found; give another path");
  }
  // Says in plain words when the file cannot be written.
  MTDB_RETURN_IF_ERROR(StoreFile::Open(real_path_, StoreFile::Access::kReadWrite).status());
  MTDB_RETURN_IF_ERROR(CheckSameFile());
  MTDB_RETURN_IF_ERROR(CheckBeforeOpen(may_be_empty));
  CloseLmdb();  // which a Pin had opened for reading
  const Status status = OpenLmdb(true, 0, true);
  if (!status.ok()) name_claim_.reset();
  return status;
}

Result<Pin> LmdbEnvironment::PinNewest() {
  Status last = Status::Ok();
  for (int i = 0; i < kTries; ++i) {
    std::shared_lock lock(mutex_);
    if (env_ == nullptr) {
      lock.unlock();
      const std::unique_lock exclusive(mutex_);
      if (env_ != nullptr) continue;
      const Status status = OpenLmdb(writable_, 0, writable_);
      if (status.ok()) continue;
      name_claim_.reset();
      return status;
    }
    MTDB_RETURN_IF_ERROR(CheckUsable());
    MDB_txn* txn = nullptr;
    const int rc = mdb_txn_begin(env_, nullptr, MDB_RDONLY, &txn);
    if (rc == 0) return Pin(this, std::move(lock), txn);
    last = Error(rc, "reading");
    if (rc == MDB_MAP_RESIZED || rc == MDB_PANIC) {
      lock.unlock();
      MTDB_RETURN_IF_ERROR(rc == MDB_PANIC ? Reopen() : AdoptMapSize());
    } else {
      int stale = 0;
      if (rc == MDB_READERS_FULL) mdb_reader_check(env_, &stale);
      if (stale == 0) return last;
    }
  }
  return last;
}

Pin::Pin(Pin&& other) noexcept
    : environment_(other.environment_), lock_(std::move(other.lock_)), txn_(other.txn_) {
  other.txn_ = nullptr;
}

Pin::~Pin() {
  if (txn_ == nullptr) return;
  mdb_txn_abort(txn_);
  lock_.unlock();
  environment_->CloseAfterPins();
}

// Whoever only pinned gives the file back.
void LmdbEnvironment::CloseAfterPins() {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock.owns_lock() || writable_) return;  // another pin is there, or somebody writes
  CloseLmdb();
  name_claim_.reset();
}

Status LmdbEnvironment::CheckUsable() {
  if (process_ != ::getpid()) {
    return InvalidArgument(file_->path() +
                           ": opened by the parent of this process; open it again after fork");
  }
  return CheckSameFile();
}

// After a meta page could not be written, LMDB wants to be opened anew.
Status LmdbEnvironment::Reopen() {
  const std::unique_lock lock(mutex_);
  CloseLmdb();
  MTDB_RETURN_IF_ERROR(CheckBeforeOpen(writable_));
  return OpenLmdb(writable_, 0, true);
}

// Another process made the file larger than the map.
Status LmdbEnvironment::AdoptMapSize() {
  const std::unique_lock lock(mutex_);
  MTDB_ASSIGN_OR_RETURN(const uint64_t bytes, file_->Size());
  return Remap(2 * bytes);
}

Status LmdbEnvironment::GrowMap() {
  const std::unique_lock lock(mutex_);
  return Remap(2 * map_size_);
}

// LMDB loses its map when it cannot change it: open anew instead, at the old size if need be.
Status LmdbEnvironment::Remap(uint64_t at_least) {
  const uint64_t before = map_size_;
  CloseLmdb();
  const Status status = OpenLmdb(writable_, at_least, false);
  if (status.ok()) return status;
  MTDB_RETURN_IF_ERROR(OpenLmdb(writable_, before, false));
  return {StatusCode::kNoSpace, file_->path() + ": no address space for a map of " +
                                    std::to_string(at_least) +
                                    " bytes; raise the limit (ulimit -v)"};
}

// ---- writing ------------------------------------------------------------------------------------

Status LmdbEnvironment::Write(const std::function<Status(WriteTransaction&)>& body) {
  for (;;) {
    int rc = 0;
    {
      std::shared_lock lock(mutex_);
      if (env_ == nullptr) return IoError(file_->path() + ": the store could not be reopened");
      MTDB_CHECK(writable_, "the database was not opened for writing");
      std::optional<OldMetaPage> superseded;
      const Status status = TryWrite(body, &rc, &superseded);
      if (superseded) {
        lock.unlock();
        RestoreMetaPage(*superseded);
        return status;
      }
      if (rc != MDB_MAP_FULL && rc != MDB_MAP_RESIZED && rc != MDB_PANIC) return status;
    }
    if (rc == MDB_MAP_FULL) {
      MTDB_RETURN_IF_ERROR(GrowMap());
    } else if (rc == MDB_MAP_RESIZED) {
      MTDB_RETURN_IF_ERROR(AdoptMapSize());
    } else {
      MTDB_RETURN_IF_ERROR(Reopen());
    }
  }
}

Status LmdbEnvironment::TryWrite(const std::function<Status(WriteTransaction&)>& body,
                                 int* lmdb_error, std::optional<OldMetaPage>* superseded) {
  MTDB_RETURN_IF_ERROR(CheckUsable());
  // A reader that died would keep freed pages from being used again.
  int stale = 0;
  mdb_reader_check(env_, &stale);
  MDB_txn* txn = nullptr;
  *lmdb_error = mdb_txn_begin(env_, nullptr, 0, &txn);
  if (*lmdb_error != 0) return Error(*lmdb_error, "writing");
  Transaction transaction(txn);
  unsigned tree = 0;
  *lmdb_error = mdb_dbi_open(txn, nullptr, 0, &tree);
  MDB_stat stat{};
  if (*lmdb_error == 0) *lmdb_error = mdb_stat(txn, tree, &stat);
  if (*lmdb_error != 0) return Error(*lmdb_error, "writing");
  WriteTransaction write(this, txn, tree);
  const Status status = Fill(write, stat.ms_entries == 0, body);
  if (!status.ok()) {
    *lmdb_error = write.lmdb_error_;
    return status;
  }
  OldMetaPage old;
  old.offset = mdb_txn_id(txn) % 2 * page_size_;
  const Status read = file_->ReadAt(old.offset, old.bytes);
  *lmdb_error = transaction.Commit();
  if (*lmdb_error == 0) return Status::Ok();
  if (read.ok()) *superseded = old;
  return Error(*lmdb_error, "writing");
}

// A meta page that LMDB could not write it leaves with its old transaction id and the new trees,
// which is what a hidden snapshot looks like (CheckSuperseded). As nobody may write meanwhile, it
// is done within a transaction, of an LMDB that knows nothing of the failure. If this fails too,
// the next opener says what there is.
void LmdbEnvironment::RestoreMetaPage(const OldMetaPage& old) {
  const std::unique_lock lock(mutex_);
  CloseLmdb();
  if (!OpenLmdb(writable_, 0, false).ok()) return;
  MDB_txn* txn = nullptr;
  if (mdb_txn_begin(env_, nullptr, 0, &txn) != 0) return;
  const Transaction transaction(txn);
  OldMetaPage now = old;
  int descriptor = -1;
  // Its transaction id comes last. Who committed in between has written another one.
  const bool is_half_new = mdb_txn_id(txn) % 2 * page_size_ == old.offset &&
                           file_->ReadAt(now.offset, now.bytes).ok() &&
                           std::equal(now.bytes.end() - sizeof(uint64_t), now.bytes.end(),
                                      old.bytes.end() - sizeof(uint64_t)) &&
                           now.bytes != old.bytes && mdb_env_get_fd(env_, &descriptor) == 0;
  if (is_half_new) {
    const auto offset = static_cast<off_t>(old.offset);
    if (::pwrite(descriptor, old.bytes.data(), old.bytes.size(), offset) > 0) ::fsync(descriptor);
  }
}

Status LmdbEnvironment::Fill(WriteTransaction& write, bool first,
                             const std::function<Status(WriteTransaction&)>& body) {
  const Bytes key = SuperblockKey();
  const std::string where = file_->path() + ": catalog: superblock";
  const uint64_t id = mdb_txn_id(write.txn_);
  MTDB_ASSIGN_OR_RETURN(const MetaPages metas, ReadMetaPages(*file_));
  uint64_t before = metas.live().txnid;
  if (first) {
    write.superblock_.map_size = metas.live().map_size;
  } else {
    MTDB_ASSIGN_OR_RETURN(const auto found, write.GetSealed(Table::kCatalog, key));
    if (!found) return Corrupt(where + ": missing");
    MTDB_ASSIGN_OR_RETURN(write.superblock_, DecodeSuperblock(*found, where));
    if (write.superblock_.transaction_id != before) before = write.superblock_.transaction_id;
  }
  // LMDB counts transactions in its lock file.
  if (before + 1 != id) {
    return Corrupt(file_->path() + ": expected transaction " + std::to_string(id - 1) +
                   " in the file, found " + std::to_string(before) +
                   "; another file was copied over it while it was open: close all programs that "
                   "have it open, and run verify");
  }
  MTDB_RETURN_IF_ERROR(body(write));
  write.superblock_.transaction_id = id;
  write.superblock_.map_size = std::max(write.superblock_.map_size, map_size_);
  MTDB_RETURN_IF_ERROR(write.PutSealed(Table::kCatalog, key, EncodeSuperblock(write.superblock_)));
  return CheckSameFile();
}

Status LmdbEnvironment::Error(int lmdb_error, const std::string& doing) const {
  const std::string what = file_->path() + ": " + doing + ": " + mdb_strerror(lmdb_error);
  const std::string kept = "; what was committed before is unharmed";
  switch (lmdb_error) {
    case ENOSPC:
    case EDQUOT:
    case EFBIG: return {StatusCode::kNoSpace, what + ": free some space and try again" + kept};
    case MDB_MAP_FULL:
    case ENOMEM: return {StatusCode::kNoSpace, what + ": free some memory and try again" + kept};
    case MDB_READERS_FULL:
      return {StatusCode::kBusy, what + ": " + std::to_string(kReaders) +
                                     " readers are active; try again when some have finished"};
    case EIO: {
      // LMDB reports a short write, which is what a full disk gives first, as EIO.
      struct statvfs disk {};
      struct rlimit limit {};
      const auto size = file_->Size();
      const bool full = ::statvfs(real_path_.c_str(), &disk) == 0 &&
                        uint64_t{disk.f_bavail} * disk.f_frsize < kLowDisk;
      const bool limited = ::getrlimit(RLIMIT_FSIZE, &limit) == 0 &&
                           limit.rlim_cur != RLIM_INFINITY && size.ok() &&
                           *size + kLowDisk > limit.rlim_cur;
      if (full || limited) {
        return {StatusCode::kNoSpace, file_->path() + ": " + doing + ": " +
                                          (full ? "the disk" : "the file size limit") +
                                          " is full: free some space and try again" + kept};
      }
      return IoError(what + ": check the disk" + kept);
    }
    case MDB_CORRUPTED:
    case MDB_PAGE_NOTFOUND:
    case MDB_INVALID:
    case MDB_BAD_TXN: return Corrupt(what + ": run verify, restore the file from a copy");
    case MDB_VERSION_MISMATCH:
      return Unsupported(what + ": the lock file belongs to another LMDB; close its programs");
    case EACCES:
    case EROFS:
    case EPERM: return IoError(what + ": the file and its -lock file must be accessible");
    default: return IoError(what);
  }
}

Result<std::optional<ByteSpan>> WriteTransaction::Get(Table table, ByteSpan key) {
  const Bytes tree_key = TreeKey(table, key);
  MDB_val k = ToVal(tree_key);
  MDB_val v;
  const int rc = mdb_get(txn_, tree_, &k, &v);
  if (rc == MDB_NOTFOUND) return std::optional<ByteSpan>();
  if (rc != 0) return Fail(rc);
  return std::optional<ByteSpan>(FromVal(v));
}

Status WriteTransaction::Put(Table table, ByteSpan key, ByteSpan value) {
  const Bytes tree_key = TreeKey(table, key);
  MDB_val k = ToVal(tree_key);
  MDB_val v = ToVal(value);
  const int rc = mdb_put(txn_, tree_, &k, &v, 0);
  return rc == 0 ? Status::Ok() : Fail(rc);
}

Status WriteTransaction::Delete(Table table, ByteSpan key) {
  const Bytes tree_key = TreeKey(table, key);
  MDB_val k = ToVal(tree_key);
  const int rc = mdb_del(txn_, tree_, &k, nullptr);
  if (rc == MDB_NOTFOUND) return NotFound(environment_->file_->path() + ": no such entry");
  return rc == 0 ? Status::Ok() : Fail(rc);
}

Result<bool> WriteTransaction::DeletePrefix(Table table, ByteSpan prefix, uint64_t max_keys,
                                            uint64_t max_bytes) {
  const Bytes tree_prefix = TreeKey(table, prefix);
  MDB_cursor* cursor = nullptr;
  int rc = mdb_cursor_open(txn_, tree_, &cursor);
  if (rc != 0) return Fail(rc);
  bool done = false;
  uint64_t keys = 0;
  uint64_t bytes = 0;
  while (keys < max_keys && bytes < max_bytes) {
    MDB_val k = ToVal(tree_prefix);
    MDB_val v;
    rc = mdb_cursor_get(cursor, &k, &v, MDB_SET_RANGE);
    if (rc == MDB_NOTFOUND ||
        (rc == 0 && (k.mv_size < tree_prefix.size() ||
                     !std::ranges::equal(FromVal(k).first(tree_prefix.size()), tree_prefix)))) {
      rc = 0;
      done = true;
      break;
    }
    if (rc != 0) break;
    ++keys;
    bytes += v.mv_size;
    rc = mdb_cursor_del(cursor, 0);
    if (rc != 0) break;
  }
  mdb_cursor_close(cursor);
  if (rc != 0) return Fail(rc);
  return done;
}

Status WriteTransaction::Scan(Table table, ByteSpan first, const Visitor& visit) {
  MDB_cursor* cursor = nullptr;
  int rc = mdb_cursor_open(txn_, tree_, &cursor);
  if (rc != 0) return Fail(rc);
  const Bytes tree_first = TreeKey(table, first);
  MDB_val k = ToVal(tree_first);
  MDB_val v;
  Status status = Status::Ok();
  rc = mdb_cursor_get(cursor, &k, &v, MDB_SET_RANGE);
  while (rc == 0 && FromVal(k)[0] == tree_first[0]) {
    const Result<bool> go_on = visit(FromVal(k).subspan(1), FromVal(v));
    if (!go_on.ok()) status = go_on.status();
    if (!go_on.ok() || !*go_on) break;
    rc = mdb_cursor_get(cursor, &k, &v, MDB_NEXT);
  }
  mdb_cursor_close(cursor);
  if (rc != 0 && rc != MDB_NOTFOUND) return Fail(rc);
  return status;
}

Result<std::optional<Bytes>> WriteTransaction::GetSealed(Table table, ByteSpan key) {
  MTDB_ASSIGN_OR_RETURN(const auto value, Get(table, key));
  if (!value) return std::optional<Bytes>();
  const std::string where =
      environment_->file_->path() + ": " + kTableNames[static_cast<size_t>(table)] + ": entry";
  MTDB_ASSIGN_OR_RETURN(const ByteSpan body, OpenValue(table, key, *value, where));
  return std::optional<Bytes>(Bytes(body.begin(), body.end()));
}

Status WriteTransaction::PutSealed(Table table, ByteSpan key, ByteSpan body) {
  return Put(table, key, SealValue(table, key, body));
}

Status WriteTransaction::Fail(int lmdb_error) {
  lmdb_error_ = lmdb_error;
  return environment_->Error(lmdb_error, "writing");
}

}  // namespace mtdb::internal
