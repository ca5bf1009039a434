// SPDX-License-Identifier: Apache-2.0
// FlatMap: a hash table in one array, for many small entries that come and go together.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "store/base/open_table.h"

namespace mtdb::internal {

struct NumberHash {
  uint64_t operator()(uint64_t number) const { return HashOfNumber(number); }
};

// With linear probing, at most half full. `Hash` spreads keys over the first bits of 64. Pointers
// to values hold until the next change.
template <typename Key, typename Value, typename Hash = NumberHash>
requires std::is_trivially_copyable_v<Key> && std::is_trivially_copyable_v<Value>
class FlatMap {
 public:
  size_t size() const { return size_; }
  bool Has(const Key& key) const { return Find(key) != nullptr; }
  const Value* Find(const Key& key) const {
    if (size_ == 0) return nullptr;
    const Entry& entry = table_.Find(Hash{}(key), Is{key});
    return entry.used ? &entry.value : nullptr;
  }
  // False, and nothing changes, when the key is there.
  bool Insert(const Key& key, const Value& value) {
    Reserve(size_ + 1);
    Entry& entry = table_.Find(Hash{}(key), Is{key});
    if (entry.used) return false;
    entry = {key, value, true};
    ++size_;
    return true;
  }
  // Over what is there.
  void Put(const Key& key, const Value& value) {
    if (!Insert(key, value)) table_.Find(Hash{}(key), Is{key}).value = value;
  }
  // Whether it was there.
  bool Erase(const Key& key) {
    if (size_ == 0) return false;
    Entry& entry = table_.Find(Hash{}(key), Is{key});
    if (!entry.used) return false;
    table_.Erase(entry, HashOf);
    --size_;
    return true;
  }
  void Reserve(size_t count) {
    if (2 * count <= table_.size()) return;
    table_.Resize(std::max({size_t{16}, 2 * count, 2 * table_.size()}), HashOf);
  }
  // Calls f(key, value) for each, in no order.
  template <typename F>
  void ForEach(F&& f) const {
    table_.ForEach([&](const Entry& entry) { f(entry.key, entry.value); });
  }

 private:
  struct Entry {
    Key key{};
    Value value{};
    bool used = false;
    bool empty() const { return !used; }
  };
  struct Is {
    const Key& key;
    bool operator()(const Entry& entry) const { return entry.key == key; }
  };
  static uint64_t HashOf(const Entry& entry) { return Hash{}(entry.key); }

  OpenTable<Entry> table_;
  size_t size_ = 0;
};

struct Nothing {};
template <typename Key, typename Hash = NumberHash>
using FlatSet = FlatMap<Key, Nothing, Hash>;

}  // namespace mtdb::internal
