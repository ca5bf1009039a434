// SPDX-License-Identifier: Apache-2.0
// Loading an object's index, and finding the keys of its values from it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/status.h"
#include "store/cluster_index.h"
#include "store/lmdb/environment.h"
#include "store/object_record.h"
#include "store/records/keys.h"

namespace mtdb::internal {

// "a.mtdb: object 3 (bunny)": how messages name an object.
std::string ObjectPlace(const std::string& path, const ObjectRecord& record);

// Gets the body of an index value; `place` names it in messages.
using IndexValueSource = std::function<Result<Bytes>(const Bytes& key, const std::string& place)>;
Result<Bytes> ReadIndexValue(const Snapshot& snapshot, const Bytes& key, const std::string& place);

// Reads all rows that the record promises and checks the whole: counts, values numbered without
// gaps, children of finer rounds only. `value_read` (may be empty) sees each value's body. `store`
// names the file.
using IndexValueReceiver = std::function<void(uint32_t first_row, ByteSpan body)>;
Result<ClusterIndex> LoadIndex(const std::string& store, const ObjectRecord& record,
                               const IndexValueSource& source,
                               const IndexValueReceiver& value_read = {});

// The keys of an object's values in the table units. Immutable.
class ValueKeys {
 public:
  ValueKeys(ObjectId id, const ClusterIndex& index);

  uint32_t count() const { return static_cast<uint32_t>(values_.size()); }
  Bytes operator[](uint32_t value) const {
    const Value& v = values_[value];
    return UnitKey(id_, v.round, v.hilbert, v.sequence);
  }

 private:
  struct Value {
    uint64_t hilbert = 0;
    uint32_t sequence = 0;
    uint8_t round = 0;
  };
  ObjectId id_;
  std::vector<Value> values_;
};

}  // namespace mtdb::internal
