// SPDX-License-Identifier: Apache-2.0
#include "store/pages/store_check.h"

#include <algorithm>
#include <string>
#include <vector>

#include "store/pages/page_walker.h"

namespace mtdb::internal {
namespace {

constexpr int kTries = 10;

// Every page from `first` to the last must be in a free list: LMDB never wrote it.
Status CheckTail(const StoreFile& file, const MetaPage& meta, uint64_t file_bytes) {
  const uint64_t first = file_bytes / meta.page_size;
  if (first > meta.last_page) return Status::Ok();
  const Status truncated = Corrupt(file.path() + ": the file has " + std::to_string(file_bytes) +
                                   " bytes, its meta page says " +
                                   std::to_string((meta.last_page + 1) * meta.page_size) +
                                   "; it was truncated: restore it from a copy");
  if (meta.last_page - first > file_bytes / 8) return truncated;
  PageReader pages(&file, meta);
  std::vector<bool> is_free(meta.last_page + 1 - first);
  const Status status = pages.Scan(
      meta.free_tree, {},
      [&](ByteSpan, const ValueRef& value) -> Result<bool> {
        MTDB_ASSIGN_OR_RETURN(const Bytes bytes, pages.ReadWhole(value, file_bytes));
        ByteReader r(bytes);
        const auto count = r.Get<uint64_t>();
        for (uint64_t i = 0; i < count && !r.failed(); ++i) {
          const auto page = r.Get<uint64_t>();
          if (page >= first && page <= meta.last_page) is_free[page - first] = true;
        }
        return true;
      },
      KeyOrder::kInteger);
  if (!status.ok() || std::ranges::find(is_free, false) != is_free.end()) return truncated;
  return Status::Ok();
}

Status CheckOnce(const StoreFile& file, const MetaPages& metas) {
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, file.Size());
  MTDB_RETURN_IF_ERROR(CheckTail(file, metas.live(), file_bytes));
  const auto state = LoadSnapshotState(file, metas.live());
  if (!state.ok()) return state.status();
  return CheckSuperseded(file, metas);
}

}  // namespace

Status CheckStoreFile(const StoreFile& file) {
  Status status = Status::Ok();
  for (int i = 0; i < kTries; ++i) {
    MTDB_ASSIGN_OR_RETURN(const MetaPages metas, ReadMetaPages(file));
    status = CheckOnce(file, metas);
    if (status.ok()) return status;
    // Nothing pins the snapshot: a commit meanwhile excuses a failure.
    MTDB_ASSIGN_OR_RETURN(const MetaPages again, ReadMetaPages(file));
    if (again.page == metas.page) return status;
  }
  return status;
}

Status CheckSuperseded(const StoreFile& file, const MetaPages& metas) {
  const MetaPage& old = metas.superseded();
  if (old.txnid == 0) return Status::Ok();
  // Its pages may be gone or in use again, which is no fault: only a readable superblock counts.
  PageReader pages(&file, old);
  const Bytes key = SuperblockKey();
  const auto value = pages.Find(old.main_tree, TreeKey(Table::kCatalog, key));
  if (!value.ok() || !*value) return Status::Ok();
  const auto bytes = pages.ReadWhole(**value, 4096);
  if (!bytes.ok()) return Status::Ok();
  const auto body = OpenValue(Table::kCatalog, key, *bytes, "");
  if (!body.ok()) return Status::Ok();
  const auto superblock = DecodeSuperblock(*body, "");
  if (!superblock.ok() || superblock->transaction_id <= old.txnid) return Status::Ok();
  return Corrupt(file.path() + ": meta page " + std::to_string(old.txnid % 2) +
                 ": expected transaction " + std::to_string(superblock->transaction_id) +
                 " of its superblock, found " + std::to_string(old.txnid) +
                 "; the newest snapshot is hidden: restore the file from a copy");
}

Status CheckTreePages(PageReader& pages) {
  const WalkReport report = WalkPages(pages, {});
  return report.failures.empty()
             ? Status::Ok()
             : Corrupt(report.failures.front() + "; run verify, restore the file from a copy");
}

}  // namespace mtdb::internal
