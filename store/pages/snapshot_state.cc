// SPDX-License-Identifier: Apache-2.0
#include "store/pages/snapshot_state.h"

#include <atomic>
#include <string>

namespace mtdb::internal {
namespace {

uint64_t NextSerial() {
  static std::atomic<uint64_t> serial{0};
  return ++serial;
}

}  // namespace

SnapshotState::SnapshotState(const StoreFile* file, const MetaPage& meta)
    : serial(NextSerial()), pages(file, meta) {}

Result<std::shared_ptr<SnapshotState>> LoadSnapshotState(const StoreFile& file,
                                                         const MetaPage& meta) {
  auto state = std::make_shared<SnapshotState>(&file, meta);
  const std::string place = file.path() + ": ";
  if (meta.main_tree.root == kNoPage) return state;
  const Bytes key = SuperblockKey();
  MTDB_ASSIGN_OR_RETURN(const auto value,
                        state->pages.Find(meta.main_tree, TreeKey(Table::kCatalog, key)));
  if (!value) {
    return Unsupported(place + "an LMDB file without an mtdb store's superblock; check the path");
  }
  MTDB_ASSIGN_OR_RETURN(const Bytes bytes, state->pages.ReadWhole(*value, 4096));
  const std::string where = place + "catalog: superblock";
  MTDB_ASSIGN_OR_RETURN(const ByteSpan body, OpenValue(Table::kCatalog, key, bytes, where));
  MTDB_ASSIGN_OR_RETURN(state->superblock, DecodeSuperblock(body, where));
  if (state->superblock.transaction_id != meta.txnid) {
    return Corrupt(where + ": expected transaction " + std::to_string(meta.txnid) +
                   " of the meta page, found " + std::to_string(state->superblock.transaction_id) +
                   "; a meta page was changed: restore the file from a copy");
  }
  if (state->superblock.map_size != meta.map_size) {
    return Corrupt(where + ": expected map size " + std::to_string(meta.map_size) +
                   " of the meta page, found " + std::to_string(state->superblock.map_size));
  }
  return state;
}

}  // namespace mtdb::internal
