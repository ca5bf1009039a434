// SPDX-License-Identifier: Apache-2.0
// SpillFile: what a query will want again and finds no room for in memory, in a temporary file.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "query/cache/loaded_unit.h"
#include "store/base/threading.h"

namespace mtdb::internal {

// Where in the file something is.
struct SpillPlace {
  uint64_t offset = 0;
  size_t bytes = 0;
};

// The file has no name, and is there from the first Write on until the object goes. Whatever fails
// (no such folder, a full disk, no memory), it is not kept, and whoever wants it makes it again
// from what is stored. Safe for many threads.
class SpillFile {
 public:
  // `folder`: empty for the system's. Holds at most `limit` bytes.
  SpillFile(const std::string& folder, uint64_t limit) : folder_(folder), limit_(limit) {}
  ~SpillFile();
  SpillFile(const SpillFile&) = delete;
  SpillFile& operator=(const SpillFile&) = delete;

  // After a failure nothing more is written.
  std::optional<SpillPlace> Write(const LoadedUnit& unit) noexcept;
  std::optional<SpillPlace> Write(ByteSpan bytes) noexcept;
  // Writes over what is at a place, as many bytes or fewer.
  bool Rewrite(const SpillPlace& place, ByteSpan bytes) noexcept;
  // Null when it cannot be read. Throws std::bad_alloc.
  LoadedUnitPtr Read(const SpillPlace& place) const;
  // `bytes` has the size of the place; false when they cannot be read.
  bool Read(const SpillPlace& place, std::span<std::byte> bytes) const;
  // False when Write would fail.
  bool open() const;
  // True until something has been written.
  bool empty() const;

 private:
  bool WriteAt(uint64_t offset, ByteSpan bytes) noexcept;
  // Room for so many bytes, in a file that is open.
  std::optional<SpillPlace> Take(size_t bytes);

  const std::string folder_;
  const uint64_t limit_;
  mutable Mutex mutex_;
  int file_ = -1;
  uint64_t used_ = 0;
  bool failed_ = false;
};

}  // namespace mtdb::internal
