// SPDX-License-Identifier: Apache-2.0
// SnapshotState: what one transaction left behind: its pages and superblock.
#pragma once

#include <cstdint>
#include <memory>

#include "store/base/status.h"
#include "store/pages/catalog_entry.h"
#include "store/pages/page_reader.h"
#include "store/records/keys.h"

namespace mtdb::internal {

// Immutable but for the pages' cache; safe for many threads.
struct SnapshotState {
  SnapshotState(const StoreFile* file, const MetaPage& meta);
  const uint64_t serial;  // of no other state in this process
  PageReader pages;
  Superblock superblock;  // of a store that was never written: the default
};

// Loads the superblock of the snapshot `meta`, and checks it against the meta page. An error counts
// only if no writer has used the snapshot's pages again meanwhile.
Result<std::shared_ptr<SnapshotState>> LoadSnapshotState(const StoreFile& file,
                                                         const MetaPage& meta);

}  // namespace mtdb::internal
