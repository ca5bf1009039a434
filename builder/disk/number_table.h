// SPDX-License-Identifier: Apache-2.0
// NumberTable: from vertices' numbers in the input to a tile's own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

#include "store/base/ids.h"
#include "store/base/open_table.h"

namespace mtdb::internal {

// Numbers are below kNone32.
class NumberTable {
 public:
  // `expected`: how many there will be, about.
  explicit NumberTable(size_t expected) { table_.Reset(2 * expected + 2); }

  // kNone32: it is not there.
  uint32_t Find(uint32_t number) const {
    return table_.Find(HashOfNumber(number), Is{number}).value;
  }
  // What is there, or now there, for `number`; true: now.
  std::pair<uint32_t, bool> Add(uint32_t number, uint32_t value) {
    Entry* entry = &table_.Find(HashOfNumber(number), Is{number});
    if (!entry->empty()) return {entry->value, false};
    if (2 * ++count_ > table_.size()) {
      table_.Resize(2 * table_.size(), [](const Entry& e) { return HashOfNumber(e.number); });
      entry = &table_.FindEmpty(HashOfNumber(number));
    }
    *entry = {number, value};
    return {value, true};
  }

 private:
  struct Entry {
    uint32_t number = kNone32, value = kNone32;
    bool empty() const { return number == kNone32; }
  };
  struct Is {
    uint32_t number;
    bool operator()(const Entry& entry) const { return entry.number == number; }
  };

  OpenTable<Entry> table_;  // half of it is free at least
  size_t count_ = 0;
};

}  // namespace mtdb::internal
