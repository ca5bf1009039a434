// SPDX-License-Identifier: Apache-2.0
#include "store/lmdb/environment.h"

#include <condition_variable>
#include <map>
#include <sys/stat.h>
#include <tuple>
#include <unistd.h>

#include "store/lmdb/test_hooks.h"
#include "store/pages/store_check.h"

namespace mtdb::internal {

// ---- registry: LMDB must not open a file twice in a process -------------------------------------

struct Environment::Registry {
  // Process, device, inode: a forked child must not use the environments of its parent.
  using Key = std::tuple<pid_t, uint64_t, uint64_t>;
  std::mutex mutex;
  std::condition_variable closed;
  std::map<Key, std::weak_ptr<Environment>> open;
};

Environment::Registry& Environment::GetRegistry() {
  static Registry* registry = new Registry;  // never destroyed: handles may outlive main()
  return *registry;
}

Result<std::shared_ptr<Environment>> Environment::Open(const std::string& path,
                                                       const OpenOptions& options) {
  StoreFile::Access access = StoreFile::Access::kRead;
  if (options.writable) {
    access = options.create ? StoreFile::Access::kCreate : StoreFile::Access::kReadWrite;
  }
  for (int i = 0;; ++i) {
    MTDB_ASSIGN_OR_RETURN(auto file, StoreFile::Open(path, access));
    const uint64_t device = file->device(), inode = file->inode();
    auto environment = TryOpen(std::move(file), options);
    if (environment.ok() || i == kTries) return environment;
    // The store may have been compacted just now, and the file be another.
    struct stat now {};
    if (::stat(path.c_str(), &now) == 0 && now.st_dev == device && now.st_ino == inode) {
      return environment;
    }
  }
}

Result<std::shared_ptr<Environment>> Environment::TryOpen(std::unique_ptr<StoreFile> file,
                                                          const OpenOptions& options) {
  const Registry::Key key{::getpid(), file->device(), file->inode()};

  // Made before the lock is taken and destroyed after it is given back, also when memory runs out:
  // its deleter takes the lock.
  std::shared_ptr<Environment> fresh(new Environment(std::move(file)), [key](Environment* e) {
    Registry& r = GetRegistry();
    const std::lock_guard guard(r.mutex);
    const bool registered = e->registered_;
    delete e;
    if (!registered) return;
    r.open.erase(key);
    r.closed.notify_all();
  });
  Registry& registry = GetRegistry();
  std::unique_lock lock(registry.mutex);
  for (auto it = registry.open.find(key); it != registry.open.end(); it = registry.open.find(key)) {
    if (auto environment = it->second.lock()) {
      lock.unlock();
      if (environment->opened()) {
        if (options.writable) MTDB_RETURN_IF_ERROR(environment->lmdb_.MakeWritable(true));
        return environment;
      }
      environment.reset();  // whoever opened it first failed: try it anew
      lock.lock();
      continue;
    }
    registry.closed.wait(lock);  // its last handle is just closing it
  }
  registry.open[key] = fresh;
  fresh->registered_ = true;
  const std::unique_lock exclusive(fresh->opening_);
  lock.unlock();
  MTDB_RETURN_IF_ERROR(fresh->OpenFirst(options));
  return fresh;
}

Environment::Environment(std::unique_ptr<StoreFile> file)
    : file_(std::move(file)), lmdb_(file_.get()) {}

Status Environment::OpenFirst(const OpenOptions& options) {
  MTDB_RETURN_IF_ERROR(options.writable ? lmdb_.MakeWritable(options.create)
                                        : CheckStoreFile(*file_));
  opened_ = true;
  return Status::Ok();
}

bool Environment::opened() const {
  const std::shared_lock lock(opening_);
  return opened_;
}

// ---- reading ------------------------------------------------------------------------------------

Result<Snapshot> Environment::Newest(bool fresh) {
  Snapshot snapshot;
  for (int i = 0; i < kTries; ++i) {
    MTDB_ASSIGN_OR_RETURN(const MetaPages metas, ReadMetaPages(*file_));
    if (!fresh) {
      const std::lock_guard lock(state_mutex_);
      if (state_ != nullptr && state_->pages.meta() == metas.live()) snapshot.state_ = state_;
    }
    if (snapshot.state_ != nullptr) {
      ReachTestPoint("snapshot taken");
      return snapshot;
    }
    auto state = LoadSnapshotState(*file_, metas.live());
    if (state.ok()) {
      snapshot.state_ = *std::move(state);
      {
        const std::lock_guard lock(state_mutex_);
        state_ = snapshot.state_;
      }
      ReachTestPoint("snapshot taken");
      return snapshot;
    }
    MTDB_ASSIGN_OR_RETURN(const MetaPages again, ReadMetaPages(*file_));
    if (again.page == metas.page) return state.status();
  }
  return Busy();
}

Result<Snapshot> Environment::NewestPinned() {
  // Pinned first: the snapshot is that one or a later one.
  auto pin = lmdb_.PinNewest();
  MTDB_ASSIGN_OR_RETURN(Snapshot snapshot, Newest(true));
  if (pin.ok()) snapshot.pin_ = std::make_shared<Pin>(*std::move(pin));
  return snapshot;
}

// A page that transaction n frees is one of snapshot n - 1, and transaction n + 2 is the first that
// may write to it. So while at most one transaction was committed after a snapshot, nothing of it
// was written to.
Result<bool> Environment::Holds(const Snapshot& snapshot) const {
  if (snapshot.pinned()) return true;
  const MetaPage& meta = snapshot.pages().meta();
  MTDB_ASSIGN_OR_RETURN(const MetaPages metas, ReadMetaPages(*file_));
  return metas.page[meta.txnid % 2] == meta &&
         (metas.live().txnid == meta.txnid || metas.live().txnid == meta.txnid + 1);
}

Status Environment::Busy() const {
  return {StatusCode::kBusy, path() + ": writers are too fast for this reader; try again"};
}

Result<std::optional<ValueRef>> Snapshot::Find(Table table, ByteSpan key) const {
  return pages().Find(pages().meta().main_tree, TreeKey(table, key));
}

Result<uint64_t> Snapshot::CountFreeBytes() const {
  const MetaPage& meta = pages().meta();
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, pages().file().Size());
  const uint64_t file_pages = file_bytes / meta.page_size;
  uint64_t free_pages = 0;
  MTDB_RETURN_IF_ERROR(pages().Scan(
      meta.free_tree, {},
      [&](ByteSpan, const ValueRef& value) -> Result<bool> {
        MTDB_ASSIGN_OR_RETURN(const Bytes bytes, pages().ReadWhole(value, file_bytes));
        ByteReader r(bytes);
        const auto count = r.Get<uint64_t>();
        for (uint64_t i = 0; i < count && !r.failed(); ++i) {
          if (r.Get<uint64_t>() < file_pages) ++free_pages;
        }
        return true;
      },
      KeyOrder::kInteger));
  return free_pages * meta.page_size;
}

Status Snapshot::Scan(Table table, ByteSpan first, const PageReader::Visitor& visit) const {
  return pages().Scan(pages().meta().main_tree, TreeKey(table, first),
                      [&](ByteSpan key, const ValueRef& value) -> Result<bool> {
                        if (key.empty() || key[0] != static_cast<std::byte>(table)) return false;
                        return visit(key.subspan(1), value);
                      });
}

}  // namespace mtdb::internal
