// SPDX-License-Identifier: Apache-2.0
// BuilderLock: tells a live builder from a dead one. An operating-system lock on one byte of the
// store file per object id or name, dropped when its holder dies. See store/FORMAT.md, "Builder's
// locks".
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "store/base/ids.h"
#include "store/base/status.h"
#include "store/carriers/store_file.h"

namespace mtdb::internal {

class BuilderLock {
 public:
  // Nothing when somebody holds it, in this process or another. `path` is the store file's.
  static Result<std::optional<BuilderLock>> TryAcquire(const std::string& path, ObjectId id);
  static Result<std::optional<BuilderLock>> TryAcquire(const std::string& path,
                                                       std::string_view name);

 private:
  static Result<std::optional<BuilderLock>> TryLock(const std::string& path, uint64_t place);
  explicit BuilderLock(std::unique_ptr<StoreFile> file) : file_(std::move(file)) {}
  std::unique_ptr<StoreFile> file_;  // an open file description of its own; closing it unlocks
};

}  // namespace mtdb::internal
