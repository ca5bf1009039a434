// SPDX-License-Identifier: Apache-2.0
// The catalog's small entries: superblock, building and garbage. Object records are in
// store/object_record.h. Layout in store/FORMAT.md.
#pragma once

#include <cstdint>
#include <string>

#include "store/base/bytes.h"
#include "store/base/status.h"

namespace mtdb::internal {

inline constexpr uint32_t kStoreVersion = 1;
inline constexpr size_t kSuperblockBytes = 48;

struct Superblock {
  uint64_t next_object_id = 1;
  uint64_t map_size = 0;
  uint64_t transaction_id = 0;
  friend bool operator==(const Superblock&, const Superblock&) = default;
};

Bytes EncodeSuperblock(const Superblock& superblock);
// kUnsupported when the magic, version or flags are not ours.
Result<Superblock> DecodeSuperblock(ByteSpan body, const std::string& where);

// Building and garbage entries.
struct PendingEntry {
  std::string name;
  uint32_t process = 0;
  friend bool operator==(const PendingEntry&, const PendingEntry&) = default;
};

Bytes EncodePendingEntry(const PendingEntry& entry);
Result<PendingEntry> DecodePendingEntry(ByteSpan body, const std::string& where);

}  // namespace mtdb::internal
