// SPDX-License-Identifier: Apache-2.0
// KeyTable: a sender's numbers for things, and the slots that the things have.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "codecs/stream/internal/memory_bytes.h"
#include "store/base/ids.h"

namespace mtdb::internal {

// A hash table with linear probing, at most half full. It holds slots alone; their keys lie in an
// array by slot.
class KeyTable {
 public:
  // The slot of a key, or kNone32.
  uint32_t Find(uint64_t key) const {
    if (size_ == 0) return kNone32;
    return table_[PlaceOf(key)];
  }
  // Of a slot that was put; it is there until the slot is put again.
  uint64_t key(uint32_t slot) const { return keys_[slot]; }
  // The slot is not there. If the key is, it gets another slot.
  void Put(uint64_t key, uint32_t slot) {
    if (2 * (size_ + size_t{1}) > table_.size()) Grow();
    if (slot >= keys_.size()) ResizeTight(keys_, slot + size_t{1});
    keys_[slot] = key;
    uint32_t& place = table_[PlaceOf(key)];
    size_ += place == kNone32 ? 1 : 0;
    place = slot;
  }
  // The slot is there.
  void Erase(uint32_t slot) {
    const size_t mask = table_.size() - 1;
    size_t hole = PlaceOf(keys_[slot]);
    // What follows moves up, unless it lies between its home and the hole.
    for (size_t i = (hole + 1) & mask; table_[i] != kNone32; i = (i + 1) & mask) {
      if (((i - Home(keys_[table_[i]])) & mask) < ((i - hole) & mask)) continue;
      table_[hole] = table_[i];
      hole = i;
    }
    table_[hole] = kNone32;
    --size_;
  }
  // Slots that are there, ascending.
  std::vector<uint32_t> Slots() const {
    std::vector<uint32_t> slots;
    for (const uint32_t slot : table_) {
      if (slot != kNone32) slots.push_back(slot);
    }
    std::sort(slots.begin(), slots.end());
    return slots;
  }
  size_t memory_bytes() const { return CapacityBytes(keys_) + CapacityBytes(table_); }

 private:
  size_t Home(uint64_t key) const { return key * 0x9e3779b97f4a7c15ull >> shift_; }
  // Where the key is, or would be.
  size_t PlaceOf(uint64_t key) const {
    size_t i = Home(key);
    while (table_[i] != kNone32 && keys_[table_[i]] != key) i = (i + 1) & (table_.size() - 1);
    return i;
  }
  void Grow() {
    std::vector<uint32_t> old(std::max<size_t>(16, 2 * table_.size()), kNone32);
    old.swap(table_);
    shift_ = 64 - std::countr_zero(table_.size());
    for (const uint32_t slot : old) {
      if (slot != kNone32) table_[PlaceOf(keys_[slot])] = slot;
    }
  }

  std::vector<uint64_t> keys_;   // by slot
  std::vector<uint32_t> table_;  // kNone32: empty
  size_t size_ = 0;
  int shift_ = 60;
};

}  // namespace mtdb::internal
