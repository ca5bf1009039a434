// ObjectReader: the ClusterSource of one object in a store file.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <unordered_map>
#include <vector>

#include "store/cluster_source.h"
#include "store/internal/environment.h"
#include "store/internal/object_index.h"

namespace mtdb {

class ObjectReader final : public ClusterSource {
 public:
  static Result<std::shared_ptr<ClusterSource>> Open(std::shared_ptr<Environment> environment,
                                                     const std::string& name);

  const ObjectRecord& record() const override { return record_; }
  const ClusterIndex& index() const override { return index_; }
  Status ReadClusters(std::span<const ClusterId> ids, const ClusterReceiver& receive) override;
  Status ReadRootPieces(std::span<const RootPieceId> ids, const RootReceiver& receive) override;
  uint64_t bytes_read() const override { return environment_->file().bytes_read(); }

 private:
  ObjectReader(std::shared_ptr<Environment> environment, ObjectRecord record, ClusterIndex index);

  // Values found in one snapshot.
  struct Resolved {
    uint64_t state = 0;  // its serial number
    std::unordered_map<uint32_t, ValueRef> values;
  };

  template <typename Id, typename Receiver>
  Status ReadAll(std::span<const Id> ids, const Receiver& receive);
  template <typename Id>
  Result<Bytes> ReadProven(Id id, Snapshot* snapshot);
  template <typename Id>
  Result<Bytes> ReadOne(const Snapshot& snapshot, Id id);
  template <typename Id>
  Result<ValueRef> FindValue(const Snapshot& snapshot, uint32_t value);
  // What to say of `failure`, which a snapshot that holds gave: that the object was removed, or
  // `failure`.
  Status Explain(const Status& failure) const;

  std::shared_ptr<Environment> environment_;
  const ObjectRecord record_;
  const ClusterIndex index_;
  const ValueKeys keys_;
  const std::string place_;
  std::mutex mutex_;  // guards the two below
  Resolved cluster_values_;
  Resolved root_values_;
};

// The payload at `location` of `value`, after its checksum has been verified.
Result<Bytes> ReadPayload(const PageReader& pages, const ValueRef& value,
                          const PayloadLocation& location, uint64_t seed, const std::string& where);

}  // namespace mtdb
