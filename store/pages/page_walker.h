// SPDX-License-Identifier: Apache-2.0
// PageWalker: visits every page that a snapshot reaches, checks the trees and accounts for every
// page of the file. What is checked: store/FORMAT.md, "What of LMDB's layout".
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "store/base/status.h"
#include "store/pages/page_reader.h"
#include "store/records/keys.h"

namespace mtdb::internal {

struct WalkOptions {
  // Whether `key` may be a separator that its deleted key left behind. Default: always.
  std::function<bool(Table table, ByteSpan key)> may_be_stale;
  // Asked at every page of a tree and every value: when it answers true, the walk ends there.
  std::function<bool()> stopped;
  // Receives the ranges of the file whose every change this walk, or the check of values, reports.
  std::function<void(uint64_t offset, uint64_t bytes)> covered;
};

struct WalkReport {
  std::vector<std::string> failures;  // at most some hundred
  uint64_t tree_pages = 0;
  uint64_t overflow_pages = 0;
  uint64_t free_pages = 0;
};

// The snapshot must be pinned. Memory: one byte per page of the file.
WalkReport WalkPages(PageReader& pages, const WalkOptions& options);

}  // namespace mtdb::internal
