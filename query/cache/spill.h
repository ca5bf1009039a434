// SPDX-License-Identifier: Apache-2.0
// Spill: which units are in the file for those that had to leave and will be wanted again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "query/cache/spill_file.h"

namespace mtdb::internal {

// There is one file while there are readers that spill, and none between. Guarded by the cache's
// mutex; the file itself is written and read without it, by whoever has a pointer.
class Spill {
 public:
  // With a limit of 0 there is never a file.
  Spill(std::string folder, uint64_t limit_bytes)
      : folder_(std::move(folder)), limit_bytes_(limit_bytes) {}

  // True for the first one: there is a new file, with nothing in it.
  bool AddReader() {
    if (limit_bytes_ == 0) return false;
    if (readers_ == 0) file_ = std::make_shared<SpillFile>(folder_, limit_bytes_);
    return readers_++ == 0;
  }
  // Of the last one, the file, which goes with the pointer: best without the mutex.
  std::shared_ptr<SpillFile> RemoveReader() {
    if (limit_bytes_ == 0 || --readers_ > 0) return nullptr;
    places_.clear();
    return std::move(file_);
  }
  uint32_t readers() const { return readers_; }
  const std::shared_ptr<SpillFile>& file() const { return file_; }

  // It is in the file, or being written.
  bool Has(UnitId unit) const { return !places_.empty() && places_[unit].has_value(); }
  // Of a unit that is in the file.
  SpillPlace place(UnitId unit) const { return *places_[unit]; }
  // The unit is about to be written, one of so many; false when it is there or cannot be.
  bool Expect(UnitId unit, size_t units) {
    if (file_ == nullptr || Has(unit) || !file_->open()) return false;
    if (places_.empty()) places_.resize(units);
    places_[unit].emplace();
    return true;
  }
  // It was written to `file`, or was not, or is not there any more.
  void Set(UnitId unit, const std::shared_ptr<SpillFile>& file, std::optional<SpillPlace> place) {
    if (file == file_ && !places_.empty()) places_[unit] = place;
  }

 private:
  const std::string folder_;
  const uint64_t limit_bytes_;
  uint32_t readers_ = 0;
  std::shared_ptr<SpillFile> file_;
  std::vector<std::optional<SpillPlace>> places_;  // by unit; empty: none is there
};

}  // namespace mtdb::internal
