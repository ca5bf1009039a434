// SPDX-License-Identifier: Apache-2.0
// VertexTable: what a tile knows of the level's vertices that it has.
#pragma once

#include <cstddef>
#include <cstdint>

#include "store/base/ids.h"
#include "store/base/open_table.h"

namespace mtdb {

// From numbers of the level's vertices to values.
template <typename Value>
class VertexTable {
 public:
  // Grows beyond `expected` vertices.
  explicit VertexTable(size_t expected) { table_.Reset(2 * expected + 2); }

  // The vertex's value, until the next call. A vertex that is new has a default one.
  Value& At(uint32_t vertex) {
    if (2 * count_ >= table_.size()) {
      table_.Resize(2 * table_.size(), [](const Slot& s) { return HashOf(s.vertex); });
    }
    Slot& slot =
        table_.Find(HashOf(vertex), [vertex](const Slot& s) { return s.vertex == vertex; });
    if (slot.empty()) {
      slot.vertex = vertex;
      ++count_;
    }
    return slot.value;
  }

 private:
  struct Slot {
    uint32_t vertex = kNone32;
    Value value{};
    bool empty() const { return vertex == kNone32; }
  };
  static uint64_t HashOf(uint32_t vertex) { return internal::HashOfNumber(vertex); }

  internal::OpenTable<Slot> table_;
  size_t count_ = 0;
};

}  // namespace mtdb
