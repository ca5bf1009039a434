// SPDX-License-Identifier: Apache-2.0
#include "store/pages/page_walker.h"

#include <algorithm>
#include <cstring>

namespace mtdb::internal {
namespace {

constexpr size_t kMaxFailures = 100;
constexpr int kMainTree = -1;
constexpr int kFreeTree = -2;

// The separators around a subtree: low <= key < high. Empty = no bound.
struct KeyBounds {
  Bytes low;
  Bytes high;
};

class PageWalker {
 public:
  PageWalker(PageReader& pages, const WalkOptions& options)
      : pages_(pages), options_(options), path_(pages.file().path()) {}

  WalkReport Walk() {
    const MetaPage& meta = pages_.meta();
    const auto file_bytes = pages_.file().Size();
    if (!file_bytes.ok()) {
      Fail(file_bytes.status().message());
      return std::move(report_);
    }
    // Only free pages may lie beyond the file's end, and each takes 8 bytes of a list.
    if (meta.last_page > *file_bytes / meta.page_size + *file_bytes / 8) {
      Fail(path_ + ": last page " + std::to_string(meta.last_page) + " is far beyond the end of " +
           std::to_string(*file_bytes) + " bytes; the file was truncated");
      return std::move(report_);
    }
    file_bytes_ = *file_bytes;
    seen_.assign(meta.last_page + 1, 0);
    Cover(meta.txnid % 2 * meta.page_size, kPageHeaderBytes + kMetaBytes);
    WalkTree(meta.free_tree, kFreeTree);
    WalkTree(meta.main_tree, kMainTree);
    if (!Stopped()) CheckPartition();
    return std::move(report_);
  }

 private:
  enum Use : uint8_t { kUnused = 0, kTree = 1, kOverflow = 2, kFree = 3 };

  struct Counts {
    uint64_t branch_pages = 0;
    uint64_t leaf_pages = 0;
    uint64_t overflow_pages = 0;
    uint64_t entries = 0;
  };

  void Fail(std::string message) {
    if (report_.failures.size() < kMaxFailures) report_.failures.push_back(std::move(message));
  }

  bool Stopped() const { return options_.stopped && options_.stopped(); }

  void Cover(uint64_t offset, uint64_t bytes) {
    if (options_.covered) options_.covered(offset, bytes);
  }

  static std::string TreeName(int tree) {
    return tree == kMainTree ? "main database" : "free database";
  }

  // False when the page is taken already.
  bool Take(uint64_t page, Use use, const std::string& by) {
    static constexpr const char* kUseNames[] = {"unused", "a tree page", "an overflow page",
                                                "free"};
    if (seen_[page] != kUnused) {
      Fail(path_ + ": page " + std::to_string(page) + ": expected in one place, found as " +
           kUseNames[use] + " in " + by + " and before as " + kUseNames[seen_[page]]);
      return false;
    }
    seen_[page] = use;
    return true;
  }

  void WalkTree(const TreeInfo& tree, int name) {
    Counts counts;
    if (tree.root != kNoPage) {
      WalkBelow(tree, name, tree.root, 0, {}, &counts);
    }
    const auto compare = [&](const char* what, uint64_t expected, uint64_t found) {
      if (expected == found) return;
      Fail(path_ + ": " + TreeName(name) + ": " + what + ": expected " + std::to_string(found) +
           " as counted, found " + std::to_string(expected));
    };
    compare("branch pages", tree.branch_pages, counts.branch_pages);
    compare("leaf pages", tree.leaf_pages, counts.leaf_pages);
    compare("overflow pages", tree.overflow_pages, counts.overflow_pages);
    compare("entries", tree.entries, counts.entries);
  }

  // Returns the subtree's first and last key; nothing when it could not be read.
  std::optional<KeyBounds> WalkBelow(const TreeInfo& tree, int name, uint64_t number, int level,
                                     const KeyBounds& bounds, Counts* counts) {
    const KeyOrder order = name == kFreeTree ? KeyOrder::kInteger : KeyOrder::kBytes;
    if (Stopped()) return std::nullopt;
    const auto loaded = pages_.LoadAt(tree, number, level, order);
    if (!loaded.ok()) {
      Fail(loaded.status().message() + " (" + TreeName(name) + ")");
      return std::nullopt;
    }
    const Page& page = **loaded;
    if (!Take(number, kTree, TreeName(name))) return std::nullopt;
    ++report_.tree_pages;
    const uint64_t base = number * pages_.meta().page_size;
    Cover(base, 8);
    Cover(base + 10, kPageHeaderBytes - 10 + 2 * page.node_count());
    return page.is_leaf() ? WalkLeaf(*loaded, name, order, bounds, counts)
                          : WalkBranch(tree, name, page, level, order, bounds, counts);
  }

  std::optional<KeyBounds> WalkBranch(const TreeInfo& tree, int name, const Page& page, int level,
                                      KeyOrder order, const KeyBounds& bounds, Counts* counts) {
    ++counts->branch_pages;
    KeyBounds extent;
    const uint64_t base = page.number() * pages_.meta().page_size;
    for (size_t i = 0; i < page.node_count(); ++i) {
      const PageNode& node = page.node(i);
      KeyBounds below;
      below.low = i == 0 ? bounds.low : Bytes(node.key.begin(), node.key.end());
      below.high = bounds.high;
      if (i + 1 < page.node_count()) {
        const ByteSpan next = page.node(i + 1).key;
        below.high.assign(next.begin(), next.end());
      }
      Cover(base + node.node_offset, kNodeHeaderBytes);
      auto child = WalkBelow(tree, name, node.child, level + 1, below, counts);
      if (!child) return std::nullopt;
      if (i > 0) CheckSeparator(name, page, i, order, extent.high, child->low);
      if (i == 0) extent.low = std::move(child->low);
      extent.high = std::move(child->high);
    }
    return extent;
  }

  void CheckSeparator(int name, const Page& page, size_t i, KeyOrder order, ByteSpan left_last,
                      ByteSpan right_first) {
    const PageNode& node = page.node(i);
    if (CompareKeys(order, node.key, right_first) != 0) {
      const bool stale =
          name == kFreeTree || !options_.may_be_stale ||
          (IsTableKey(node.key) &&
           options_.may_be_stale(static_cast<Table>(node.key[0]), node.key.subspan(1)));
      if (!stale) {
        Fail(path_ + ": page " + std::to_string(page.number()) + ": node " + std::to_string(i) +
             ": separator is neither the first key to its right nor a removed object's");
      }
      return;
    }
    // Within one object every change of the separator is noticed; between two, it may look stale.
    constexpr size_t kObject = 9;  // table and object
    if (name == kMainTree && left_last.size() >= kObject && right_first.size() >= kObject &&
        left_last[0] != static_cast<std::byte>(Table::kCatalog) &&
        std::equal(left_last.begin(), left_last.begin() + kObject, right_first.begin())) {
      Cover(page.number() * pages_.meta().page_size + node.node_offset + kNodeHeaderBytes,
            node.key.size());
    }
  }

  std::optional<KeyBounds> WalkLeaf(const std::shared_ptr<const Page>& page, int name,
                                    KeyOrder order, const KeyBounds& bounds, Counts* counts) {
    ++counts->leaf_pages;
    const uint64_t base = page->number() * pages_.meta().page_size;
    for (size_t i = 0; i < page->node_count(); ++i) {
      if (Stopped()) return std::nullopt;
      const PageNode& node = page->node(i);
      const std::string place = path_ + ": page " + std::to_string(page->number()) + ": node " +
                                std::to_string(i) + " of the " + TreeName(name) + ": ";
      ++counts->entries;
      if ((!bounds.low.empty() && CompareKeys(order, node.key, bounds.low) < 0) ||
          (!bounds.high.empty() && CompareKeys(order, node.key, bounds.high) >= 0)) {
        Fail(place + "expected a key between the separators above it");
      }
      if (node.flags == kNodeTree) Fail(place + "expected a value, found a named database");
      if (name == kMainTree && !IsTableKey(node.key)) Fail(place + "a key of no table");
      const uint64_t at = base + node.node_offset;
      const bool large = node.flags == kNodeOverflow;
      // Of a free list on overflow pages, the size may be more than the list needs.
      if (name == kFreeTree) {
        Cover(large ? at + 4 : at, large ? 4 : kNodeHeaderBytes);
      } else {
        Cover(at, kNodeHeaderBytes + node.key.size());
      }
      if (large) Cover(at + kNodeHeaderBytes + node.key.size(), 8);
      const auto value = pages_.Resolve(page, node);
      if (!value.ok()) {
        Fail(value.status().message() + " (" + TreeName(name) + ")");
        continue;
      }
      if (large) TakeOverflow(node, value->overflow_pages, name, counts);
      if (name == kFreeTree) {
        CheckFreeList(node, *value, place);
      } else {
        Cover(value->file_offset, value->size);
      }
    }
    const auto copy = [](ByteSpan key) { return Bytes(key.begin(), key.end()); };
    return KeyBounds{copy(page->node(0).key), copy(page->node(page->node_count() - 1).key)};
  }

  static bool IsTableKey(ByteSpan key) {
    return !key.empty() && static_cast<size_t>(key[0]) < kTables;
  }

  void TakeOverflow(const PageNode& node, uint64_t run, int name, Counts* counts) {
    const uint32_t page_size = pages_.meta().page_size;
    for (uint64_t i = 0; i < run; ++i) {
      if (!Take(node.overflow_page + i, kOverflow, TreeName(name))) break;
    }
    counts->overflow_pages += run;
    report_.overflow_pages += run;
    const uint64_t base = node.overflow_page * page_size;
    Cover(base, 8);
    Cover(base + 10, kPageHeaderBytes - 10);
  }

  void CheckFreeList(const PageNode& node, const ValueRef& value, const std::string& place) {
    uint64_t txnid;
    std::memcpy(&txnid, node.key.data(), sizeof(txnid));
    if (txnid == 0 || txnid > pages_.meta().txnid) {
      Fail(place + "expected a transaction from 1 to " + std::to_string(pages_.meta().txnid) +
           ", found " + std::to_string(txnid));
    }
    const auto bytes = pages_.ReadWhole(value, file_bytes_);
    if (!bytes.ok()) {
      Fail(bytes.status().message());
      return;
    }
    ByteReader r(*bytes);
    const auto count = r.Get<uint64_t>();
    if (r.failed() || count > r.remaining() / 8 || value.size % 8 != 0) {
      Fail(place + "a list of " + std::to_string(count) + " pages does not fit its " +
           std::to_string(value.size) + " bytes");
      return;
    }
    Cover(value.file_offset, 8 + 8 * count);
    uint64_t previous = kNoPage;
    for (uint64_t i = 0; i < count; ++i) {
      const auto page = r.Get<uint64_t>();
      if (page < kMetaPages || page > pages_.meta().last_page || page >= previous) {
        Fail(place + "expected free pages that descend, from " +
             std::to_string(pages_.meta().last_page) + " to 2, found " + std::to_string(page));
        return;
      }
      previous = page;
      ++report_.free_pages;
      Take(page, kFree, "a free list");
    }
  }

  void CheckPartition() {
    if (!report_.failures.empty()) return;  // pages behind a broken one are missing anyway
    uint64_t lost = 0;
    uint64_t first = 0;
    for (uint64_t p = kMetaPages; p < seen_.size(); ++p) {
      if (seen_[p] == kUnused && lost++ == 0) first = p;
      if (seen_[p] != kUnused && seen_[p] != kFree &&
          (p + 1) * pages_.meta().page_size > file_bytes_)
        Fail(path_ + ": page " + std::to_string(p) +
             ": lies beyond the file's end; it was truncated");
    }
    if (lost > 0) {
      Fail(path_ + ": page " + std::to_string(first) + ": neither in use nor free, and " +
           std::to_string(lost - 1) + " more such pages");
    }
  }

  PageReader& pages_;
  const WalkOptions& options_;
  const std::string path_;
  uint64_t file_bytes_ = 0;
  std::vector<uint8_t> seen_;
  WalkReport report_;
};

}  // namespace

WalkReport WalkPages(PageReader& pages, const WalkOptions& options) {
  return PageWalker(pages, options).Walk();
}

}  // namespace mtdb::internal
