// SPDX-License-Identifier: Apache-2.0
// PageReader: looks keys up in one snapshot of a store file, by reading pages and checking them.
// It does not use LMDB's tree code, which trusts its pages. A writer may use the snapshot's pages
// again meanwhile (Environment::Holds tells): results are then errors or anything else that passes
// the checks, never a crash.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>

#include "store/carriers/store_file.h"
#include "store/pages/meta_page.h"
#include "store/pages/page.h"

namespace mtdb::internal {

// Where a value lies.
struct ValueRef {
  uint64_t size = 0;
  uint64_t file_offset = 0;
  uint64_t overflow_pages = 0;       // that hold it, 0 when it lies within a leaf page
  std::shared_ptr<const Page> page;  // of a value within a leaf page, else null
  PageNode node;                     // valid while `page` is held
};

// Safe for many threads.
class PageReader {
 public:
  // `file` must outlive the reader.
  PageReader(const StoreFile* file, const MetaPage& meta);

  const MetaPage& meta() const { return meta_; }
  const StoreFile& file() const { return *file_; }

  // A checked copy of a branch or leaf page. Keeps the last ones read.
  Result<std::shared_ptr<const Page>> Load(uint64_t number, KeyOrder order);

  Result<std::optional<ValueRef>> Find(const TreeInfo& tree, ByteSpan key,
                                       KeyOrder order = KeyOrder::kBytes);

  // Calls `visit` with the keys from `first` on, ascending, until it answers false.
  using Visitor = std::function<Result<bool>(ByteSpan key, const ValueRef& value)>;
  Status Scan(const TreeInfo& tree, ByteSpan first, const Visitor& visit,
              KeyOrder order = KeyOrder::kBytes);

  // Copies out.size() bytes of the value from `offset` on; the range must be inside the value.
  Status ReadValue(const ValueRef& value, uint64_t offset, std::span<std::byte> out) const;
  // All of it; a value above `limit` bytes is kCorrupt.
  Result<Bytes> ReadWhole(const ValueRef& value, uint64_t limit) const;

  // Resolves a leaf's node: checks the header of its overflow pages, when it has any.
  Result<ValueRef> Resolve(const std::shared_ptr<const Page>& page, const PageNode& node) const;

  // Reads tree pages of a depth that the tree's record promises; a page's kind must agree.
  Result<std::shared_ptr<const Page>> LoadAt(const TreeInfo& tree, uint64_t number, int level,
                                             KeyOrder order);

 private:
  Status ScanBelow(const TreeInfo& tree, uint64_t number, int level, ByteSpan first,
                   const Visitor& visit, KeyOrder order, Bytes* previous, bool* go_on);

  const StoreFile* file_;
  const MetaPage meta_;
  uint64_t file_bytes_ = 0;  // when the snapshot was taken: all its pages lie below
  std::mutex mutex_;         // guards cache_
  std::unordered_map<uint64_t, std::shared_ptr<const Page>> cache_;
};

}  // namespace mtdb::internal
