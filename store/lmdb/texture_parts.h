// SPDX-License-Identifier: Apache-2.0
// TextureParts: cuts the files of an object's texture into values of the store.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/running_hash.h"
#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb::internal {

// Holds one value's bytes, and of each file its length and checksum. Single thread.
class TextureParts {
 public:
  // Writes part `part` of a file, which has kPagePartBytes, or less when it is the last one.
  using PutPart = std::function<Status(uint32_t file, uint32_t part, Bytes bytes)>;

  // `object` names it in messages.
  TextureParts(std::string object, PutPart put)
      : object_(std::move(object)), put_(std::move(put)) {}

  // Appends to the file. Errors: kInvalidArgument (a file before the last one, too many bytes),
  // those of `put`.
  Status Add(uint32_t file, ByteSpan bytes);
  // Nothing more will come.
  Status Finish();
  // After Finish(). kInvalidArgument when the record has other files, an image too many bytes, or
  // two pages one name.
  Status Check(const ObjectRecord& record) const;

 private:
  struct File {
    uint32_t number = 0;
    uint64_t bytes = 0;
    uint64_t checksum = 0;
  };
  Status PutWaiting();

  const std::string object_;
  const PutPart put_;
  std::vector<File> files_;          // those that have bytes
  std::optional<RunningHash> hash_;  // of the last one, while it may grow
  uint32_t parts_ = 0;               // of it, written
  Bytes waiting_;                    // its last bytes
};

}  // namespace mtdb::internal
