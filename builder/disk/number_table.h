// SPDX-License-Identifier: Apache-2.0
// NumberTable: from vertices' numbers in the input to a tile's own.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "store/base/ids.h"

namespace mtdb::internal {

// Numbers are below kNone32.
class NumberTable {
 public:
  // `expected`: how many there will be, about.
  explicit NumberTable(size_t expected) : entries_(std::bit_ceil(2 * expected + 2)) {}

  // kNone32: it is not there.
  uint32_t Find(uint32_t number) const { return entries_[PlaceOf(number)].value; }
  // What is there, or now there, for `number`; true: now.
  std::pair<uint32_t, bool> Add(uint32_t number, uint32_t value) {
    size_t at = PlaceOf(number);
    if (entries_[at].number == number) return {entries_[at].value, false};
    if (2 * ++count_ > entries_.size()) {
      Grow();
      at = PlaceOf(number);
    }
    entries_[at] = {number, value};
    return {value, true};
  }

 private:
  struct Entry {
    uint32_t number = kNone32, value = kNone32;
  };
  // Where it is, or would be.
  size_t PlaceOf(uint32_t number) const {
    const size_t mask = entries_.size() - 1;
    size_t at = (number * 0x9e3779b97f4a7c15ull >> 24) & mask;
    while (entries_[at].number != kNone32 && entries_[at].number != number) at = (at + 1) & mask;
    return at;
  }
  void Grow() {
    const std::vector<Entry> old = std::exchange(entries_, std::vector<Entry>(2 * entries_.size()));
    for (const Entry& e : old) {
      if (e.number != kNone32) entries_[PlaceOf(e.number)] = e;
    }
  }

  std::vector<Entry> entries_;  // a power of two; half of them are free at least
  size_t count_ = 0;
};

}  // namespace mtdb::internal
