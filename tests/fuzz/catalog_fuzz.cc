// SPDX-License-Identifier: Apache-2.0
// libFuzzer target: what the catalog holds, behind its checksums. The first byte chooses the kind
// of entry.
#include <cstddef>
#include <cstdint>

#include "store/object_record.h"
#include "store/pages/catalog_entry.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  if (size == 0) return 0;
  const auto body = mtdb::ByteSpan(reinterpret_cast<const std::byte*>(data), size).subspan(1);
  bool same = true;  // what was read is read again when written
  if (data[0] % 3 == 0) {
    const auto superblock = mtdb::internal::DecodeSuperblock(body, "fuzz");
    if (superblock.ok()) {
      const auto again =
          mtdb::internal::DecodeSuperblock(mtdb::internal::EncodeSuperblock(*superblock), "fuzz");
      same = again.ok() && *again == *superblock;
    }
  } else if (data[0] % 3 == 1) {
    const auto entry = mtdb::internal::DecodePendingEntry(body, "fuzz");
    if (entry.ok()) {
      const auto again =
          mtdb::internal::DecodePendingEntry(mtdb::internal::EncodePendingEntry(*entry), "fuzz");
      same = again.ok() && *again == *entry;
    }
  } else {
    const auto record = mtdb::DecodeObjectRecord(body, "fuzz");
    if (record.ok()) {
      const mtdb::Bytes bytes = mtdb::EncodeObjectRecord(*record);
      const auto again = mtdb::DecodeObjectRecord(bytes, "fuzz");
      same = again.ok() && mtdb::EncodeObjectRecord(*again) == bytes;
    }
  }
  if (!same) __builtin_trap();
  return 0;
}
