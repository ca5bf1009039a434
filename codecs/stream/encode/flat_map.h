// SPDX-License-Identifier: Apache-2.0
// FlatMap: a hash table in one array, for many small entries that come and go together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

namespace mtdb::internal {

struct NumberHash {
  uint64_t operator()(uint64_t number) const { return number * 0x9e3779b97f4a7c15ull; }
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
    const Entry& entry = entries_[PlaceOf(key)];
    return entry.used ? &entry.value : nullptr;
  }
  // False, and nothing changes, when the key is there.
  bool Insert(const Key& key, const Value& value) {
    if (2 * (size_ + 1) > entries_.size()) Grow(size_ + 1);
    Entry& entry = entries_[PlaceOf(key)];
    if (entry.used) return false;
    entry = {key, value, true};
    ++size_;
    return true;
  }
  // Over what is there.
  void Put(const Key& key, const Value& value) {
    if (Insert(key, value)) return;
    entries_[PlaceOf(key)].value = value;
  }
  // Whether it was there.
  bool Erase(const Key& key) {
    if (size_ == 0) return false;
    size_t hole = PlaceOf(key);
    if (!entries_[hole].used) return false;
    // What follows moves up, unless it lies between its home and the hole.
    const size_t mask = entries_.size() - 1;
    for (size_t i = (hole + 1) & mask; entries_[i].used; i = (i + 1) & mask) {
      if (((i - Home(entries_[i].key)) & mask) < ((i - hole) & mask)) continue;
      entries_[hole] = entries_[i];
      hole = i;
    }
    entries_[hole].used = false;
    --size_;
    return true;
  }
  void Reserve(size_t count) {
    if (2 * count > entries_.size()) Grow(count);
  }
  // Calls f(key, value) for each, in no order.
  template <typename F>
  void ForEach(F&& f) const {
    for (const Entry& entry : entries_) {
      if (entry.used) f(entry.key, entry.value);
    }
  }

 private:
  struct Entry {
    Key key{};
    Value value{};
    bool used = false;
  };
  size_t Home(const Key& key) const { return Hash{}(key) >> shift_; }
  // Where the key is, or would be.
  size_t PlaceOf(const Key& key) const {
    size_t i = Home(key);
    while (entries_[i].used && !(entries_[i].key == key)) i = (i + 1) & (entries_.size() - 1);
    return i;
  }
  void Grow(size_t count) {
    size_t size = 16;
    int bits = 4;
    for (; size < 2 * count || size <= entries_.size(); size *= 2) ++bits;
    std::vector<Entry> old(size);
    old.swap(entries_);
    shift_ = 64 - bits;
    for (const Entry& entry : old) {
      if (entry.used) entries_[PlaceOf(entry.key)] = entry;
    }
  }

  std::vector<Entry> entries_;
  size_t size_ = 0;
  int shift_ = 60;
};

struct Nothing {};
template <typename Key, typename Hash = NumberHash>
using FlatSet = FlatMap<Key, Nothing, Hash>;

}  // namespace mtdb::internal
