// SPDX-License-Identifier: Apache-2.0
#include "store/pages/page_reader.h"

#include <array>
#include <cstring>

namespace mtdb::internal {
namespace {

constexpr size_t kCachedPages = 4096;

}  // namespace

PageReader::PageReader(const StoreFile* file, const MetaPage& meta) : file_(file), meta_(meta) {
  const auto size = file->Size();
  if (size.ok()) file_bytes_ = *size;
}

Result<std::shared_ptr<const Page>> PageReader::Load(uint64_t number, KeyOrder order) {
  if (number < kMetaPages || number > meta_.last_page) {
    return Corrupt(file_->path() + ": expected a page number from 2 to " +
                   std::to_string(meta_.last_page) + ", found " + std::to_string(number));
  }
  {
    const std::lock_guard lock(mutex_);
    const auto it = cache_.find(number);
    if (it != cache_.end()) {
      if (it->second->order() == order) return it->second;
      return Corrupt(file_->path() + ": page " + std::to_string(number) +
                     ": expected in one tree, found in two");
    }
  }
  Bytes bytes(meta_.page_size);
  MTDB_RETURN_IF_ERROR(file_->ReadAt(number * meta_.page_size, bytes));
  MTDB_ASSIGN_OR_RETURN(auto page, Page::Decode(std::move(bytes), number, order, file_->path()));
  const std::lock_guard lock(mutex_);
  if (cache_.size() >= kCachedPages) cache_.clear();
  cache_[number] = page;
  return page;
}

Result<std::shared_ptr<const Page>> PageReader::LoadAt(const TreeInfo& tree, uint64_t number,
                                                       int level, KeyOrder order) {
  MTDB_ASSIGN_OR_RETURN(auto page, Load(number, order));
  const bool leaf = level + 1 == tree.depth;
  if (page->is_leaf() != leaf) {
    return Corrupt(file_->path() + ": page " + std::to_string(number) + ": expected a " +
                   (leaf ? "leaf" : "branch") + " at level " + std::to_string(level) +
                   " of a tree of depth " + std::to_string(tree.depth));
  }
  return page;
}

Result<ValueRef> PageReader::Resolve(const std::shared_ptr<const Page>& page,
                                     const PageNode& node) const {
  ValueRef value;
  value.size = node.value_bytes;
  value.node = node;
  if (node.flags != kNodeOverflow) {
    value.page = page;
    value.file_offset = page->number() * meta_.page_size + node.value_offset;
    return value;
  }
  const uint64_t needed = OverflowPages(value.size, meta_.page_size);
  const uint64_t first = node.overflow_page;
  const auto fits = [&](uint64_t pages) {
    return first >= kMetaPages && first <= meta_.last_page && pages <= meta_.last_page - first + 1;
  };
  if (!fits(needed)) {
    return Corrupt(file_->path() + ": page " + std::to_string(page->number()) + ": expected " +
                   std::to_string(needed) + " overflow pages from 2 to " +
                   std::to_string(meta_.last_page) + ", found page " + std::to_string(first));
  }
  if ((first + needed) * meta_.page_size > file_bytes_) {
    return Corrupt(file_->path() + ": page " + std::to_string(first) + ": expected " +
                   std::to_string(needed) + " overflow pages in a file of " +
                   std::to_string(file_bytes_) + " bytes; it was truncated");
  }
  std::array<std::byte, kPageHeaderBytes> bytes;
  MTDB_RETURN_IF_ERROR(file_->ReadAt(first * meta_.page_size, bytes));
  ByteReader r(bytes);
  const auto number = r.Get<uint64_t>();
  r.Get<uint16_t>();
  const auto flags = r.Get<uint16_t>();
  const auto run = r.Get<uint32_t>();
  if (number != first || flags != kPageOverflow || run < needed || !fits(run)) {
    return Corrupt(file_->path() + ": page " + std::to_string(first) + ": expected the first of " +
                   std::to_string(needed) + " overflow pages, found page " +
                   std::to_string(number) + ", flags " + std::to_string(flags) + ", " +
                   std::to_string(run) + " pages");
  }
  value.overflow_pages = run;
  value.file_offset = first * meta_.page_size + kPageHeaderBytes;
  return value;
}

Result<std::optional<ValueRef>> PageReader::Find(const TreeInfo& tree, ByteSpan key,
                                                 KeyOrder order) {
  if (tree.root == kNoPage) return std::optional<ValueRef>();
  uint64_t number = tree.root;
  for (int level = 0;; ++level) {
    MTDB_ASSIGN_OR_RETURN(const auto page, LoadAt(tree, number, level, order));
    if (!page->is_leaf()) {
      number = page->node(page->ChildFor(key)).child;
      continue;
    }
    const size_t i = page->LowerBound(key);
    if (i == page->node_count() || CompareKeys(order, page->node(i).key, key) != 0) {
      return std::optional<ValueRef>();
    }
    MTDB_ASSIGN_OR_RETURN(ValueRef value, Resolve(page, page->node(i)));
    return std::optional<ValueRef>(std::move(value));
  }
}

Status PageReader::Scan(const TreeInfo& tree, ByteSpan first, const Visitor& visit,
                        KeyOrder order) {
  if (tree.root == kNoPage) return Status::Ok();
  Bytes previous;
  bool go_on = true;
  return ScanBelow(tree, tree.root, 0, first, visit, order, &previous, &go_on);
}

// Keys must ascend from leaf to leaf; as leaves are not empty, no page is visited twice.
Status PageReader::ScanBelow(const TreeInfo& tree, uint64_t number, int level, ByteSpan first,
                             const Visitor& visit, KeyOrder order, Bytes* previous, bool* go_on) {
  MTDB_ASSIGN_OR_RETURN(const auto page, LoadAt(tree, number, level, order));
  if (!page->is_leaf()) {
    size_t i = first.empty() ? 0 : page->ChildFor(first);
    for (; i < page->node_count() && *go_on; ++i) {
      MTDB_RETURN_IF_ERROR(
          ScanBelow(tree, page->node(i).child, level + 1, first, visit, order, previous, go_on));
      first = {};
    }
    return Status::Ok();
  }
  size_t i = first.empty() ? 0 : page->LowerBound(first);
  for (; i < page->node_count() && *go_on; ++i) {
    const PageNode& node = page->node(i);
    if (!previous->empty() && CompareKeys(order, *previous, node.key) >= 0) {
      return Corrupt(file_->path() + ": page " + std::to_string(number) + ": node " +
                     std::to_string(i) + ": expected a key above the ones of the page before");
    }
    previous->assign(node.key.begin(), node.key.end());
    MTDB_ASSIGN_OR_RETURN(const ValueRef value, Resolve(page, node));
    MTDB_ASSIGN_OR_RETURN(*go_on, visit(node.key, value));
  }
  return Status::Ok();
}

Status PageReader::ReadValue(const ValueRef& value, uint64_t offset,
                             std::span<std::byte> out) const {
  MTDB_CHECK(offset <= value.size && out.size() <= value.size - offset, "range in the value");
  if (value.page != nullptr) {
    if (!out.empty()) {
      std::memcpy(out.data(), value.page->InlineValue(value.node).data() + offset, out.size());
    }
    return Status::Ok();
  }
  return file_->ReadAt(value.file_offset + offset, out);
}

Result<Bytes> PageReader::ReadWhole(const ValueRef& value, uint64_t limit) const {
  if (value.size > limit) {
    return Corrupt(file_->path() + ": offset " + std::to_string(value.file_offset) +
                   ": expected a value of at most " + std::to_string(limit) + " bytes, found " +
                   std::to_string(value.size));
  }
  Bytes bytes(value.size);
  MTDB_RETURN_IF_ERROR(ReadValue(value, 0, bytes));
  return bytes;
}

}  // namespace mtdb::internal
