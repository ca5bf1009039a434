// SPDX-License-Identifier: Apache-2.0
// The two meta pages of a store file, read and checked before LMDB sees the file.
#pragma once

#include <array>
#include <cstdint>

#include "store/base/status.h"
#include "store/carriers/store_file.h"
#include "store/pages/page.h"

namespace mtdb::internal {

struct MetaPage {
  uint32_t page_size = 0;
  uint64_t map_size = 0;
  TreeInfo free_tree;
  TreeInfo main_tree;
  uint64_t last_page = 0;
  uint64_t txnid = 0;
  friend bool operator==(const MetaPage&, const MetaPage&) = default;
};

struct MetaPages {
  std::array<MetaPage, 2> page;
  const MetaPage& live() const { return page[page[1].txnid > page[0].txnid ? 1 : 0]; }
  const MetaPage& superseded() const { return page[page[1].txnid > page[0].txnid ? 0 : 1]; }
};

// Checks one meta page by itself. `page` = kPageHeaderBytes + kMetaBytes bytes.
Result<MetaPage> DecodeMetaPage(ByteSpan bytes, uint64_t number, const std::string& where);

// Reads both, each in a state that no writer was changing, and checks every field of both, and the
// one against the other. kBadInput, with what the file seems to be, when it has no meta page at
// all.
Result<MetaPages> ReadMetaPages(const StoreFile& file);

// Whether a file has no more than what making a store has written of it: nothing, zeros, or meta
// pages of transaction 0.
bool NeverCommitted(const StoreFile& file);

// The meta page of transaction `txnid`; kNotFound when two later transactions have overwritten it.
Result<MetaPage> ReadMetaPageOf(const StoreFile& file, uint64_t txnid, uint32_t page_size);

}  // namespace mtdb::internal
