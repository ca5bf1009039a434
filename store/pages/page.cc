// SPDX-License-Identifier: Apache-2.0
#include "store/pages/page.h"

#include <algorithm>
#include <cstring>

#include "store/base/check.h"

namespace mtdb::internal {
namespace {

template <typename T>
T At(const Bytes& bytes, size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

uint64_t IntegerKey(ByteSpan key) {
  uint64_t value;
  std::memcpy(&value, key.data(), sizeof(value));
  return value;
}

constexpr size_t RoundUpEven(size_t n) { return n + (n & 1); }

}  // namespace

int CompareKeys(KeyOrder order, ByteSpan a, ByteSpan b) {
  if (order == KeyOrder::kInteger) {
    MTDB_CHECK(a.size() == 8 && b.size() == 8, "integer keys have 8 bytes");
    const uint64_t x = IntegerKey(a);
    const uint64_t y = IntegerKey(b);
    return x < y ? -1 : x > y ? 1 : 0;
  }
  const size_t common = std::min(a.size(), b.size());
  const int c = common == 0 ? 0 : std::memcmp(a.data(), b.data(), common);
  if (c != 0) return c;
  return a.size() < b.size() ? -1 : a.size() > b.size() ? 1 : 0;
}

TreeInfo ReadTreeInfo(ByteReader& reader) {
  TreeInfo t;
  t.pad = reader.Get<uint32_t>();
  t.flags = reader.Get<uint16_t>();
  t.depth = reader.Get<uint16_t>();
  t.branch_pages = reader.Get<uint64_t>();
  t.leaf_pages = reader.Get<uint64_t>();
  t.overflow_pages = reader.Get<uint64_t>();
  t.entries = reader.Get<uint64_t>();
  t.root = reader.Get<uint64_t>();
  return t;
}

Result<std::shared_ptr<const Page>> Page::Decode(Bytes bytes, uint64_t number, KeyOrder order,
                                                 const std::string& where) {
  const std::string place = where + ": page " + std::to_string(number) + ": ";
  const auto fail = [&](const std::string& what, uint64_t expected, uint64_t found) {
    return Corrupt(place + what + ": expected " + std::to_string(expected) + ", found " +
                   std::to_string(found));
  };
  const size_t size = bytes.size();
  MTDB_CHECK(size >= kMinPageSize && size <= kMaxPageSize, "not a page size");

  const auto found_number = At<uint64_t>(bytes, 0);
  if (found_number != number) return fail("page number", number, found_number);
  const auto flags = At<uint16_t>(bytes, 10);
  if (flags != kPageLeaf && flags != kPageBranch) {
    return Corrupt(place + "expected a branch or leaf page, found flags " + std::to_string(flags));
  }
  const auto lower = At<uint16_t>(bytes, 12);
  const auto upper = At<uint16_t>(bytes, 14);
  if (lower <= kPageHeaderBytes || lower % 2 != 0 || lower > upper || upper > size) {
    return Corrupt(place + "expected free space within the page, found " + std::to_string(lower) +
                   ".." + std::to_string(upper));
  }

  std::shared_ptr<Page> page(new Page);
  page->bytes_ = std::move(bytes);
  page->number_ = number;
  page->is_leaf_ = flags == kPageLeaf;
  page->order_ = order;
  const Bytes& b = page->bytes_;
  const size_t count = (lower - kPageHeaderBytes) / 2;
  page->nodes_.resize(count);
  std::vector<std::pair<uint32_t, uint32_t>> extents(count);  // begin and end of each node
  for (size_t i = 0; i < count; ++i) {
    PageNode& node = page->nodes_[i];
    const std::string node_place = "node " + std::to_string(i) + ": ";
    const size_t at = At<uint16_t>(b, kPageHeaderBytes + 2 * i);
    if (at < upper || at + kNodeHeaderBytes > size || at % 2 != 0) {
      return Corrupt(place + node_place + "expected an even offset from " + std::to_string(upper) +
                     " to " + std::to_string(size - kNodeHeaderBytes) + ", found " +
                     std::to_string(at));
    }
    const auto low = At<uint32_t>(b, at);
    const auto node_flags = At<uint16_t>(b, at + 4);
    const auto key_bytes = At<uint16_t>(b, at + 6);
    node.node_offset = static_cast<uint32_t>(at);
    const size_t value_at = at + kNodeHeaderBytes + key_bytes;
    const bool first_branch_key = !page->is_leaf_ && i == 0;
    if (key_bytes > kMaxKeyBytes || value_at > size || (key_bytes == 0 && !first_branch_key)) {
      return Corrupt(place + node_place + "expected a key of 1 to " + std::to_string(kMaxKeyBytes) +
                     " bytes within the page, found " + std::to_string(key_bytes));
    }
    if (order == KeyOrder::kInteger && key_bytes != 8 && !(first_branch_key && key_bytes == 0)) {
      return fail(node_place + "bytes of an integer key", 8, key_bytes);
    }
    node.key = ByteSpan(b).subspan(at + kNodeHeaderBytes, key_bytes);
    size_t end = value_at;
    if (page->is_leaf_) {
      node.flags = node_flags;
      node.value_bytes = low;
      if (node_flags != 0 && node_flags != kNodeOverflow && node_flags != kNodeTree) {
        return fail(node_place + "flags", 0, node_flags);
      }
      // A value that was made smaller in its transaction may stay on overflow pages.
      const bool large = node_flags == kNodeOverflow;
      if (!large && kNodeHeaderBytes + key_bytes + uint64_t{low} >
                        MaxNodeBytes(static_cast<uint32_t>(size))) {
        return Corrupt(place + node_place + "expected a value of " + std::to_string(low) +
                       " bytes on overflow pages");
      }
      end += large ? 8 : low;
      if (end > size) return fail(node_place + "end of the node at most", size, end);
      if (large) {
        node.overflow_page = At<uint64_t>(b, value_at);
      } else {
        node.value_offset = static_cast<uint32_t>(value_at);
      }
    } else {
      node.child = low | uint64_t{node_flags} << 32;
    }
    extents[i] = {static_cast<uint32_t>(at), static_cast<uint32_t>(RoundUpEven(end))};
    if (i > (page->is_leaf_ ? 0u : 1u) &&
        CompareKeys(order, page->nodes_[i - 1].key, node.key) >= 0) {
      return Corrupt(place + node_place + "expected a key above the one before it");
    }
  }
  std::sort(extents.begin(), extents.end());
  uint32_t next = upper;
  for (const auto& [begin, end] : extents) {
    if (begin != next) return fail("nodes side by side: next node at", next, begin);
    next = end;
  }
  if (next != size) return fail("end of the nodes", size, next);
  return std::shared_ptr<const Page>(std::move(page));
}

size_t Page::LowerBound(ByteSpan key) const {
  const auto it = std::partition_point(nodes_.begin(), nodes_.end(), [&](const PageNode& n) {
    return CompareKeys(order_, n.key, key) < 0;
  });
  return static_cast<size_t>(it - nodes_.begin());
}

size_t Page::ChildFor(ByteSpan key) const {
  const auto it = std::partition_point(nodes_.begin() + 1, nodes_.end(), [&](const PageNode& n) {
    return CompareKeys(order_, n.key, key) <= 0;
  });
  return static_cast<size_t>(it - nodes_.begin()) - 1;
}

}  // namespace mtdb::internal
