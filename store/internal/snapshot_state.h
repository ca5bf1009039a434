// SnapshotState: what one transaction left behind: its pages, tables and superblock.
#pragma once

#include <array>
#include <memory>

#include "store/base/status.h"
#include "store/internal/catalog_entry.h"
#include "store/internal/keys.h"
#include "store/internal/page_reader.h"

namespace mtdb {

// Immutable but for the pages' cache; safe for many threads.
struct SnapshotState {
  SnapshotState(const StoreFile* file, const MetaPage& meta) : pages(file, meta) {}
  PageReader pages;
  std::array<TreeInfo, kTables> trees;
  Superblock superblock;  // of a store that was never written: the default
};

// Loads the tables' trees and the superblock of the snapshot `meta`, and checks the superblock
// against it. The snapshot must be pinned, or nobody may be writing.
Result<std::shared_ptr<SnapshotState>> LoadSnapshotState(const StoreFile& file,
                                                         const MetaPage& meta);

}  // namespace mtdb
