// SPDX-License-Identifier: Apache-2.0
// Page: one branch or leaf page of LMDB's B+tree, copied and checked field by field before anybody
// looks at a node. Layout and legal values: store/FORMAT.md, "What of LMDB's layout".
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb::internal {

inline constexpr size_t kPageHeaderBytes = 16;
inline constexpr size_t kNodeHeaderBytes = 8;
inline constexpr size_t kTreeInfoBytes = 48;
inline constexpr size_t kMetaBytes = 136;  // after the page header
inline constexpr size_t kMaxKeyBytes = 511;
inline constexpr uint64_t kMetaPages = 2;
inline constexpr uint64_t kNoPage = ~uint64_t{0};
inline constexpr int kMaxTreeDepth = 32;
inline constexpr uint32_t kMinPageSize = 512;
inline constexpr uint32_t kMaxPageSize = 32768;

inline constexpr uint16_t kPageBranch = 0x01;
inline constexpr uint16_t kPageLeaf = 0x02;
inline constexpr uint16_t kPageOverflow = 0x04;
inline constexpr uint16_t kPageMeta = 0x08;

inline constexpr uint16_t kNodeOverflow = 0x01;
inline constexpr uint16_t kNodeTree = 0x02;

inline constexpr uint16_t kFreeTreeFlags = 0x4008;  // one file, integer keys

// One B+tree, as its parent record describes it.
struct TreeInfo {
  uint32_t pad = 0;
  uint16_t flags = 0;
  uint16_t depth = 0;
  uint64_t branch_pages = 0;
  uint64_t leaf_pages = 0;
  uint64_t overflow_pages = 0;
  uint64_t entries = 0;
  uint64_t root = kNoPage;
  friend bool operator==(const TreeInfo&, const TreeInfo&) = default;
};

enum class KeyOrder : uint8_t { kBytes, kInteger };

// memcmp, then the length; or u64 little-endian (both keys must have 8 bytes).
int CompareKeys(KeyOrder order, ByteSpan a, ByteSpan b);

TreeInfo ReadTreeInfo(ByteReader& reader);

// A value above this many bytes of node goes to overflow pages.
constexpr size_t MaxNodeBytes(uint32_t page_size) {
  return ((page_size - kPageHeaderBytes) / 2 & ~size_t{1}) - 2;
}
constexpr uint64_t OverflowPages(uint64_t value_bytes, uint32_t page_size) {
  return (kPageHeaderBytes + value_bytes + page_size - 1) / page_size;
}

struct PageNode {
  ByteSpan key;
  uint64_t child = 0;          // branch pages
  uint32_t value_bytes = 0;    // leaf pages
  uint16_t flags = 0;          // leaf pages
  uint32_t value_offset = 0;   // of the value in the page, unless it lies on overflow pages
  uint64_t overflow_page = 0;  // kNodeOverflow
  uint32_t node_offset = 0;    // of the node in the page
};

// Immutable; safe for many threads.
class Page {
 public:
  // Checks everything that one page can be checked for alone. `where` names the file.
  static Result<std::shared_ptr<const Page>> Decode(Bytes bytes, uint64_t number, KeyOrder order,
                                                    const std::string& where);

  uint64_t number() const { return number_; }
  bool is_leaf() const { return is_leaf_; }
  KeyOrder order() const { return order_; }
  size_t node_count() const { return nodes_.size(); }
  const PageNode& node(size_t i) const { return nodes_[i]; }
  ByteSpan bytes() const { return bytes_; }
  // Of a leaf's node that is not on overflow pages.
  ByteSpan InlineValue(const PageNode& node) const {
    return ByteSpan(bytes_).subspan(node.value_offset, node.value_bytes);
  }
  // The first node whose key is not below `key`; node_count() when there is none. Leaf pages.
  size_t LowerBound(ByteSpan key) const;
  // The child that covers `key`. Branch pages.
  size_t ChildFor(ByteSpan key) const;

 private:
  Page() = default;

  Bytes bytes_;
  uint64_t number_ = 0;
  bool is_leaf_ = false;
  KeyOrder order_ = KeyOrder::kBytes;
  std::vector<PageNode> nodes_;
};

}  // namespace mtdb::internal
