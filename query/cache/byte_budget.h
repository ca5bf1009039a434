// SPDX-License-Identifier: Apache-2.0
// ByteBudget: how many bytes there may be at a time, and how many there are.
#pragma once

#include <algorithm>
#include <cstddef>

namespace mtdb::internal {

// Whoever keeps something in memory adds its bytes, and looks for room before.
class ByteBudget {
 public:
  explicit ByteBudget(size_t limit) : limit_(limit) {}

  size_t limit() const { return limit_; }
  size_t used() const { return used_; }
  // The most that used() has been.
  size_t peak() const { return peak_; }
  bool HasRoom(size_t bytes) const { return used_ + bytes <= limit_; }
  void Add(size_t bytes) {
    used_ += bytes;
    peak_ = std::max(peak_, used_);
  }
  void Remove(size_t bytes) { used_ -= bytes; }

 private:
  const size_t limit_;
  size_t used_ = 0;
  size_t peak_ = 0;
};

}  // namespace mtdb::internal
