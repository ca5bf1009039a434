// SPDX-License-Identifier: Apache-2.0
// LateWriter: an ObjectWriter whose store and object come to be with its first write, so that an
// input that cannot be stored leaves no trace.
#pragma once

#include <memory>
#include <string>

#include "store/database.h"

namespace mtdb {

class LateWriter final : public ObjectWriter {
 public:
  LateWriter(std::string store, std::string name, bool replace)
      : store_(std::move(store)), name_(std::move(name)), replace_(replace) {}

  // Says early what the first write would say: a bad name, no such folder, a file that is not a
  // store, an object of that name, which must not be replaced.
  Status Check() const;

  Result<UnitId> Add(const UnitEntry& entry, std::span<const UnitId> children,
                     ByteSpan payload) override;
  Status AddTextureFile(uint32_t file, ByteSpan part) override;
  Result<ObjectRecord> Publish(const ObjectRecord& record,
                               const BeforePublish& before = {}) override;

  // After Publish().
  Result<uint64_t> StoreBytes() const { return database_->FileBytes(); }

 private:
  Status Begin();
  std::string store_;
  std::string name_;
  bool replace_;
  std::shared_ptr<Database> database_;
  std::unique_ptr<ObjectWriter> writer_;
};

}  // namespace mtdb
