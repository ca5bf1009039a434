// SPDX-License-Identifier: Apache-2.0
#include "store/pages/meta_page.h"

#include <algorithm>
#include <array>
#include <bit>

#include "store/base/file_kind.h"

namespace mtdb::internal {
namespace {

constexpr uint32_t kMagic = 0xbeefc0de;
constexpr uint32_t kDataVersion = 1;
constexpr uint64_t kMaxPages = uint64_t{1} << 48;
constexpr int kStableReadTries = 100;

Status CheckTree(const TreeInfo& tree, uint64_t last_page, const std::string& place) {
  if (tree.root == kNoPage) {
    if (tree.depth != 0 || tree.entries != 0 || tree.branch_pages != 0 || tree.leaf_pages != 0 ||
        tree.overflow_pages != 0) {
      return Corrupt(place + "expected no pages in a tree without a root");
    }
    return Status::Ok();
  }
  if (tree.root < kMetaPages || tree.root > last_page) {
    return Corrupt(place + "expected a root page from 2 to " + std::to_string(last_page) +
                   ", found " + std::to_string(tree.root));
  }
  if (tree.depth < 1 || tree.depth > kMaxTreeDepth) {
    return Corrupt(place + "expected a depth from 1 to 32, found " + std::to_string(tree.depth));
  }
  return Status::Ok();
}

// The file has no meta page where one could lie: it was no store before it was damaged.
bool HasNoMetaPage(const StoreFile& file, uint64_t file_bytes) {
  constexpr uint64_t kMagicOffset = kPageHeaderBytes;
  const auto is_magic = [&](uint64_t page_begin) {
    std::array<std::byte, sizeof(uint32_t)> bytes;
    if (page_begin + kMagicOffset + bytes.size() > file_bytes) return false;
    // What cannot be read is told by who reads it.
    return !file.ReadAt(page_begin + kMagicOffset, bytes).ok() ||
           ByteReader(bytes).Get<uint32_t>() == kMagic;
  };
  if (is_magic(0)) return false;
  for (uint64_t size = kMinPageSize; size <= kMaxPageSize; size *= 2) {
    if (is_magic(size)) return false;
  }
  return true;
}

// kBadInput for what never was a store, with what it seems to be.
Status CheckIsStore(const StoreFile& file) {
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, file.Size());
  Bytes start(std::min<uint64_t>(file_bytes, kFileKindBytes));
  MTDB_RETURN_IF_ERROR(file.ReadAt(0, start));
  const std::string_view kind = KindOfFile(AsString(start));
  if (SeemsStore(AsString(start)) || SeemsPackedFile(AsString(start))) return Status::Ok();
  // What is left of a store may be too short for a meta page.
  if (kind.empty() && file_bytes < kMetaPages * kMinPageSize) return Status::Ok();
  if (!HasNoMetaPage(file, file_bytes)) return Status::Ok();
  return BadInput(file.path() + ": this is no file of mtdb" +
                  (kind.empty() ? "" : ", but seems to be " + std::string(kind)) +
                  "; check the path ('mtdb ingest MESH STORE' makes a store of a mesh)");
}

// A writer changes a meta page by one write; two equal reads in a row saw no half of it.
Status ReadStable(const StoreFile& file, uint64_t offset, Bytes* bytes) {
  bytes->resize(kPageHeaderBytes + kMetaBytes);
  Bytes again(bytes->size());
  MTDB_RETURN_IF_ERROR(file.ReadAt(offset, *bytes));
  for (int i = 0; i < kStableReadTries; ++i) {
    MTDB_RETURN_IF_ERROR(file.ReadAt(offset, again));
    if (again == *bytes) return Status::Ok();
    std::swap(again, *bytes);
  }
  return {StatusCode::kBusy, file.path() + ": meta page keeps changing; try again"};
}

Result<MetaPages> TryReadMetaPages(const StoreFile& file) {
  MTDB_ASSIGN_OR_RETURN(const uint64_t file_bytes, file.Size());
  if (file_bytes < kMetaPages * kMinPageSize) {
    return Corrupt(file.path() + ": " + std::to_string(file_bytes) +
                   " bytes are too few for a store; it was cut short (restore it from a copy), "
                   "or is no store at all");
  }
  Status last = Status::Ok();
  for (int i = 0; i < kStableReadTries; ++i) {
    Bytes bytes;
    MetaPages metas;
    MTDB_RETURN_IF_ERROR(ReadStable(file, 0, &bytes));
    MTDB_ASSIGN_OR_RETURN(metas.page[0], DecodeMetaPage(bytes, 0, file.path()));
    const uint32_t page_size = metas.page[0].page_size;
    if (file_bytes < kMetaPages * page_size) {
      return Corrupt(file.path() + ": the file has " + std::to_string(file_bytes) +
                     " bytes, a store at least " + std::to_string(kMetaPages * page_size) +
                     "; it was truncated: restore it from a copy");
    }
    MTDB_RETURN_IF_ERROR(ReadStable(file, page_size, &bytes));
    MTDB_ASSIGN_OR_RETURN(metas.page[1], DecodeMetaPage(bytes, 1, file.path()));
    if (metas.page[1].page_size != page_size) {
      return Corrupt(file.path() + ": meta page 1: page size: expected " +
                     std::to_string(page_size) + ", found " +
                     std::to_string(metas.page[1].page_size));
    }
    const uint64_t live = metas.live().txnid;
    const uint64_t superseded = metas.superseded().txnid;
    const bool parity =
        metas.page[0].txnid % 2 == 0 && (metas.page[1].txnid % 2 == 1 || metas.page[1].txnid == 0);
    if (parity && (live == superseded + 1 || (live == 0 && superseded == 0))) return metas;
    // Two commits may have come between the two reads: look again.
    last = Corrupt(file.path() + ": meta pages 0 and 1: expected consecutive transaction ids, " +
                   "even and odd, found " + std::to_string(metas.page[0].txnid) + " and " +
                   std::to_string(metas.page[1].txnid) + "; restore the file from a copy");
  }
  return last;
}

}  // namespace

Result<MetaPage> DecodeMetaPage(ByteSpan bytes, uint64_t number, const std::string& where) {
  const std::string place = where + ": meta page " + std::to_string(number) + ": ";
  const auto fail = [&](const std::string& what, uint64_t expected, uint64_t found) {
    return Corrupt(place + what + ": expected " + std::to_string(expected) + ", found " +
                   std::to_string(found));
  };
  ByteReader r(bytes);
  const auto page_number = r.Get<uint64_t>();
  const auto pad = r.Get<uint16_t>();
  const auto flags = r.Get<uint16_t>();
  const auto lower_upper = r.Get<uint32_t>();
  const auto magic = r.Get<uint32_t>();
  const auto version = r.Get<uint32_t>();
  const auto address = r.Get<uint64_t>();
  MetaPage meta;
  meta.map_size = r.Get<uint64_t>();
  meta.free_tree = ReadTreeInfo(r);
  meta.main_tree = ReadTreeInfo(r);
  meta.last_page = r.Get<uint64_t>();
  meta.txnid = r.Get<uint64_t>();
  meta.page_size = meta.free_tree.pad;
  if (r.failed()) return fail("bytes", kPageHeaderBytes + kMetaBytes, bytes.size());

  if (magic != kMagic) {
    return Corrupt(place +
                   "this is not an mtdb store; check the path ('mtdb ingest MESH STORE' makes a "
                   "store of a mesh)");
  }
  if (version != kDataVersion) {
    return Unsupported(place + "LMDB data version " + std::to_string(version) +
                       ", mtdb reads version 1");
  }
  if (page_number != number) return fail("page number", number, page_number);
  if (flags != kPageMeta) return fail("flags", kPageMeta, flags);
  if (pad != 0 || lower_upper != 0) return fail("header padding", 0, pad | lower_upper);
  if (address != 0) return fail("address", 0, address);
  if (meta.page_size < kMinPageSize || meta.page_size > kMaxPageSize ||
      !std::has_single_bit(meta.page_size)) {
    return Corrupt(place + "expected a page size of 512 to 32768, found " +
                   std::to_string(meta.page_size));
  }
  if (meta.free_tree.flags != kFreeTreeFlags) {
    return fail("flags of the free database", kFreeTreeFlags, meta.free_tree.flags);
  }
  if (meta.main_tree.flags != 0) return fail("flags of the main database", 0, meta.main_tree.flags);
  if (meta.main_tree.pad != 0) return fail("padding of the main database", 0, meta.main_tree.pad);
  if (meta.last_page < kMetaPages - 1 || meta.last_page >= kMaxPages) {
    return Corrupt(place + "expected a last page from 1, found " + std::to_string(meta.last_page));
  }
  if (meta.map_size / meta.page_size < meta.last_page) {
    return Corrupt(place + "expected a map size above the last page, found " +
                   std::to_string(meta.map_size));
  }
  MTDB_RETURN_IF_ERROR(CheckTree(meta.free_tree, meta.last_page, place + "free database: "));
  MTDB_RETURN_IF_ERROR(CheckTree(meta.main_tree, meta.last_page, place + "main database: "));
  return meta;
}

bool NeverCommitted(const StoreFile& file) {
  const Result<uint64_t> size = file.Size();
  if (!size.ok() || *size > kMetaPages * kMaxPageSize) return false;
  Bytes bytes(*size);
  if (!file.ReadAt(0, bytes).ok()) return false;
  const auto zero = [](ByteSpan part) {
    return std::ranges::all_of(part, [](std::byte b) { return b == std::byte{0}; });
  };
  if (zero(bytes)) return true;
  const Result<MetaPage> first = DecodeMetaPage(bytes, 0, file.path());
  if (!first.ok() || first->txnid != 0 || *size > kMetaPages * first->page_size) return false;
  const ByteSpan rest = ByteSpan(bytes).subspan(std::min<uint64_t>(*size, first->page_size));
  if (rest.size() < kPageHeaderBytes + kMetaBytes || zero(rest)) return true;
  const Result<MetaPage> second = DecodeMetaPage(rest, 1, file.path());
  return second.ok() && second->txnid == 0;
}

Result<MetaPages> ReadMetaPages(const StoreFile& file) {
  Result<MetaPages> metas = TryReadMetaPages(file);
  if (metas.ok()) return metas;
  if (!NeverCommitted(file)) {
    if (Status none = CheckIsStore(file); !none.ok()) return none;
    return metas;
  }
  return Corrupt(file.path() +
                 ": the file is empty: either nothing was stored in it yet, and an ingest makes it "
                 "a store, or it was truncated: restore it from a copy");
}

Result<MetaPage> ReadMetaPageOf(const StoreFile& file, uint64_t txnid, uint32_t page_size) {
  Bytes bytes;
  const uint64_t number = txnid % 2;
  MTDB_RETURN_IF_ERROR(ReadStable(file, number * page_size, &bytes));
  MTDB_ASSIGN_OR_RETURN(MetaPage meta, DecodeMetaPage(bytes, number, file.path()));
  if (meta.txnid != txnid) {
    return NotFound(file.path() + ": meta page " + std::to_string(number) +
                    ": expected transaction " + std::to_string(txnid) + ", found " +
                    std::to_string(meta.txnid));
  }
  return meta;
}

}  // namespace mtdb::internal
