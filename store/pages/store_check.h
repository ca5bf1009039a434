// SPDX-License-Identifier: Apache-2.0
// What is checked before LMDB may see a store file, since LMDB trusts what it maps.
#pragma once

#include "store/base/status.h"
#include "store/carriers/store_file.h"
#include "store/pages/snapshot_state.h"

namespace mtdb::internal {

// Meta pages, the file's size (a truncated file is refused), the live superblock, and that the
// other meta page is not the later one in disguise. Costs some ten page reads. Safe beside writers.
Status CheckStoreFile(const StoreFile& file);

// All tree pages and free lists of a pinned snapshot: what a writer builds on. The first failure.
Status CheckTreePages(PageReader& pages);

// kCorrupt when the superseded meta page's tree was written later than its transaction id says.
Status CheckSuperseded(const StoreFile& file, const MetaPages& metas);

}  // namespace mtdb::internal
