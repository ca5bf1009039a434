// SPDX-License-Identifier: Apache-2.0
#include "store/pages/catalog_entry.h"

#include <algorithm>
#include <array>

#include "store/records/keys.h"

namespace mtdb::internal {
namespace {

constexpr std::string_view kMagic{"mtdb store\0\0\0\0\0\0", 16};

}  // namespace

Bytes EncodeSuperblock(const Superblock& superblock) {
  ByteWriter w;
  w.PutBytes(AsBytes(kMagic));
  w.Put(kStoreVersion);
  w.Put(uint32_t{0});
  w.Put(superblock.next_object_id);
  w.Put(superblock.map_size);
  w.Put(superblock.transaction_id);
  MTDB_CHECK(w.size() == kSuperblockBytes, "superblock size");
  return w.Take();
}

Result<Superblock> DecodeSuperblock(ByteSpan body, const std::string& where) {
  ByteReader r(body);
  const ByteSpan magic = r.GetBytes(kMagic.size());
  const auto version = r.Get<uint32_t>();
  const auto flags = r.Get<uint32_t>();
  Superblock s;
  s.next_object_id = r.Get<uint64_t>();
  s.map_size = r.Get<uint64_t>();
  s.transaction_id = r.Get<uint64_t>();
  if (!std::ranges::equal(magic, AsBytes(kMagic))) {
    return Unsupported(where + ": an LMDB file, but not an mtdb store; check the path");
  }
  if (version != kStoreVersion) {
    return Unsupported(where + ": store version " + std::to_string(version) +
                       ", this program reads version " + std::to_string(kStoreVersion) +
                       "; use a newer program");
  }
  if (flags != 0) {
    return Unsupported(where + ": store flags " + std::to_string(flags) +
                       " are unknown; use a newer program");
  }
  if (r.failed() || r.remaining() != 0) {
    return Corrupt(where + ": expected " + std::to_string(kSuperblockBytes) + " bytes, found " +
                   std::to_string(body.size()));
  }
  return s;
}

Bytes EncodePendingEntry(const PendingEntry& entry) {
  ByteWriter w;
  w.PutString(entry.name);
  w.Put(entry.process);
  return w.Take();
}

Result<PendingEntry> DecodePendingEntry(ByteSpan body, const std::string& where) {
  ByteReader r(body);
  PendingEntry e;
  e.name = r.GetString();
  e.process = r.Get<uint32_t>();
  if (r.failed() || r.remaining() != 0 || e.name.empty() || e.name.size() > kMaxNameBytes) {
    return Corrupt(where + ": expected a name and a process id, found " +
                   std::to_string(body.size()) + " bytes");
  }
  return e;
}

}  // namespace mtdb::internal
