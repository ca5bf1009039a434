// SPDX-License-Identifier: Apache-2.0
// ObjectDigest: the order-free sum of 128 bits over an object's content, free of its id and name.
// See store/FORMAT.md, "Digest of an object".
#pragma once

#include <cstdint>

#include "store/base/bytes.h"
#include "store/object_record.h"
#include "store/records/keys.h"

namespace mtdb::internal {

class ObjectDigest {
 public:
  void AddUnit(UnitId id, uint8_t round, uint64_t hilbert, ByteSpan payload) {
    low_ += Hash64(payload, MixAll('C', 1, id, round, hilbert));
    high_ += Hash64(payload, MixAll('C', 2, id, round, hilbert));
  }
  void AddIndexValue(uint32_t first_row, ByteSpan body) {
    low_ += Hash64(body, MixAll('I', 1, first_row));
    high_ += Hash64(body, MixAll('I', 2, first_row));
  }
  void AddRecord(ObjectRecord record) {
    record.id = ObjectId{1};
    record.name = "x";
    record.payload_bytes = record.stored_bytes = record.index_checksum = 0;
    record.digest_low = record.digest_high = 0;
    const Bytes bytes = EncodeObjectRecord(record);
    low_ += Hash64(bytes, MixAll('K', 1));
    high_ += Hash64(bytes, MixAll('K', 2));
  }

  uint64_t low() const { return low_; }
  uint64_t high() const { return high_; }

 private:
  uint64_t low_ = 0;
  uint64_t high_ = 0;
};

}  // namespace mtdb::internal
