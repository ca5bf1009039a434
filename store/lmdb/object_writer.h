// SPDX-License-Identifier: Apache-2.0
// StoreObjectWriter: the ObjectWriter of a store file.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "store/lmdb/builder_lock.h"
#include "store/lmdb/environment.h"
#include "store/lmdb/texture_parts.h"
#include "store/object_writer.h"
#include "store/records/object_digest.h"

namespace mtdb::internal {

class StoreObjectWriter final : public ObjectWriter {
 public:
  static Result<std::unique_ptr<ObjectWriter>> Create(std::shared_ptr<Environment> environment,
                                                      const std::string& name, bool replace);
  ~StoreObjectWriter() override;

  Result<UnitId> Add(const UnitEntry& entry, std::span<const UnitId> children,
                     ByteSpan payload) override;
  Status AddTextureFile(uint32_t file, ByteSpan part) override;
  Result<ObjectRecord> Publish(const ObjectRecord& record,
                               const BeforePublish& before = {}) override;

 private:
  // A unit whose value is not complete yet.
  struct Waiting {
    UnitEntry entry;
    std::vector<UnitId> children;
    Bytes payload;
    uint64_t checksum = 0;
  };
  struct QueuedValue {
    Table table = Table::kUnits;
    Bytes key;
    Bytes value;
  };

  StoreObjectWriter(std::shared_ptr<Environment> environment, std::string name, bool replace,
                    BuilderLock name_lock, std::pair<ObjectId, BuilderLock> reserved);

  Status CheckChildren(std::span<const UnitId> children, uint32_t below) const;
  Status PackUnits(bool last);
  Status QueueIndex();
  Status QueueTexturePart(uint32_t file, uint32_t part, const Bytes& bytes);
  Status Queue(Table table, Bytes key, Bytes value);
  Status PutQueue(WriteTransaction& write) const;
  Status WriteQueue();
  Result<ObjectRecord> FlipCatalog(ObjectRecord record, std::optional<ObjectId>* replaced);

  std::shared_ptr<Environment> environment_;
  const std::string name_;
  const bool replace_;
  const ObjectId id_;
  BuilderLock name_lock_;
  BuilderLock id_lock_;
  bool begun_ = false;  // a building entry is in the catalog
  bool published_ = false;

  ClusterIndex index_;  // without what waits
  std::vector<Waiting> waiting_;
  std::vector<uint64_t> waiting_bytes_;  // of the payloads
  uint8_t round_ = 0;
  uint32_t round_begin_ = 0;  // first unit of round_
  uint64_t hilbert_ = 0;
  uint32_t values_ = 0;
  uint8_t value_round_ = 0;       // that the last value began in
  uint32_t values_of_round_ = 0;  // that began in it before the last one

  std::vector<QueuedValue> queue_;
  uint64_t queued_bytes_ = 0;
  uint64_t payload_bytes_ = 0;
  uint64_t index_checksum_ = 0;
  uint64_t overflow_bytes_ = 0;
  uint64_t node_bytes_ = 0;
  ObjectDigest digest_;
  TextureParts textures_;
};

}  // namespace mtdb::internal
