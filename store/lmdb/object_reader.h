// SPDX-License-Identifier: Apache-2.0
// ObjectReader: the ClusterSource of one object in a store file.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "store/cluster_source.h"
#include "store/lmdb/environment.h"
#include "store/lmdb/object_index.h"

namespace mtdb::internal {

class ObjectReader final : public ClusterSource {
 public:
  static Result<std::shared_ptr<ClusterSource>> Open(std::shared_ptr<Environment> environment,
                                                     const std::string& name);

  // Of a pinned snapshot, whose object `record` is: reads that snapshot and no other.
  static Result<std::shared_ptr<ClusterSource>> OpenPinned(std::shared_ptr<Environment> environment,
                                                           ObjectRecord record,
                                                           const Snapshot& snapshot);

  const ObjectRecord& record() const override { return record_; }
  const ClusterIndex& index() const override { return index_; }
  void Read(std::span<const UnitId> units, std::shared_ptr<PayloadReceiver> receiver) override;
  Result<Bytes> ReadTextureFile(uint32_t file, uint64_t offset, uint64_t bytes) override;
  bool answers_at_once() const override { return true; }
  uint64_t bytes_read() const override { return environment_->file().bytes_read(); }

 private:
  ObjectReader(std::shared_ptr<Environment> environment, ObjectRecord record, ClusterIndex index);

  // Values found in one snapshot.
  struct Resolved {
    uint64_t state = 0;  // its serial number
    std::unordered_map<uint32_t, ValueRef> values;
  };

  // What proves itself by its checksum.
  using ReadProof = std::function<Result<Bytes>(const Snapshot&)>;
  Result<Bytes> ReadProven(const ReadProof& read, Snapshot* snapshot);
  Result<Bytes> ReadParts(uint32_t file, uint64_t offset, uint64_t bytes);
  Result<Bytes> ReadOne(const Snapshot& snapshot, UnitId unit);
  Result<ValueRef> FindValue(const Snapshot& snapshot, uint32_t value);
  // What to say of `failure`, which a snapshot that holds gave: that the object was removed, or
  // `failure`.
  Status Explain(const Status& failure) const;

  std::shared_ptr<Environment> environment_;
  const ObjectRecord record_;
  const ClusterIndex index_;
  const ValueKeys keys_;
  const std::string place_;
  std::mutex mutex_;  // guards the one below
  Resolved resolved_;
  std::optional<Snapshot> pinned_;
};

// A part of a file of the texture, after its checksum has been verified. `where` names the object.
Result<Bytes> ReadTexturePart(const Snapshot& snapshot, const ObjectRecord& record, uint32_t file,
                              uint32_t part, const std::string& where);

// The payload at `location` of `value`, after its checksum has been verified.
Result<Bytes> ReadPayload(const PageReader& pages, const ValueRef& value,
                          const PayloadLocation& location, uint64_t seed, const std::string& where);

}  // namespace mtdb::internal
