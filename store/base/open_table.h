// SPDX-License-Identifier: Apache-2.0
// OpenTable: a hash table in one array, whose slots hold what its user wants.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "store/base/ids.h"

namespace mtdb::internal {

// Spreads small numbers over the upper bits of 64, by the golden ratio.
constexpr uint64_t HashOfNumber(uint64_t number) { return number * 0x9e3779b97f4a7c15ull; }

// Probing is linear. A slot is the place of a thing that lies elsewhere (kNone32: the slot is
// empty), a pointer to it, or a struct with a function empty(); a default struct is empty. The user
// knows the keys: it passes their hashes, whose upper bits are spread, and tells by `is` whether a
// slot that is not empty is the one that is looked for. It also counts, and keeps at least one slot
// empty; half of them, or a quarter, for speed. References to slots hold until the next change of
// the size, or Erase().
template <typename Slot>
requires std::is_trivially_copyable_v<Slot>
class OpenTable {
 public:
  // How many slots there are, empty ones included: none, or a power of two.
  size_t size() const { return slots_.size(); }
  uint64_t memory_bytes() const { return slots_.capacity() * sizeof(Slot); }
  static constexpr bool Empty(const Slot& slot) {
    if constexpr (std::is_class_v<Slot>) {
      return slot.empty();
    } else {
      return slot == kEmpty;
    }
  }

  // The slot that `is` accepts, or else the empty one in which it would be. There are slots.
  template <typename Is>
  Slot& Find(uint64_t hash, const Is& is) {
    return slots_[PlaceOf(hash, is)];
  }
  template <typename Is>
  const Slot& Find(uint64_t hash, const Is& is) const {
    return slots_[PlaceOf(hash, is)];
  }
  // The empty slot for what is not there.
  Slot& FindEmpty(uint64_t hash) {
    return Find(hash, [](const Slot&) { return false; });
  }
  // The slot at which the search for a hash begins.
  const Slot& Home(uint64_t hash) const { return slots_[hash >> shift_]; }

  // All slots are empty then, at least so many; they lie in the memory that there is, if they can.
  void Reset(size_t least) {
    slots_.assign(SizeFor(least), kEmpty);
    SetShift();
  }
  // Gives the memory back. There are no slots then.
  void Release() { slots_ = std::vector<Slot>(); }
  // What is there stays, in at least so many slots; without the memory for them, where it is.
  // `hash_of` tells the hash of a slot.
  template <typename HashOf>
  void Resize(size_t least, const HashOf& hash_of) {
    std::vector<Slot> old(SizeFor(least), kEmpty);
    old.swap(slots_);
    SetShift();
    for (const Slot& slot : old) {
      if (!Empty(slot)) FindEmpty(hash_of(slot)) = slot;
    }
  }
  // Empties a slot of this table; others may move to where it was.
  template <typename HashOf>
  void Erase(Slot& slot, const HashOf& hash_of) {
    const size_t mask = slots_.size() - 1;
    auto hole = static_cast<size_t>(&slot - slots_.data());
    // What follows moves up, unless it lies between its home and the hole.
    for (size_t i = (hole + 1) & mask; !Empty(slots_[i]); i = (i + 1) & mask) {
      if (((i - (hash_of(slots_[i]) >> shift_)) & mask) < ((i - hole) & mask)) continue;
      slots_[hole] = slots_[i];
      hole = i;
    }
    slots_[hole] = kEmpty;
  }
  // Calls f(slot) for each that is not empty, in no order.
  template <typename F>
  void ForEach(const F& f) const {
    for (const Slot& slot : slots_) {
      if (!Empty(slot)) f(slot);
    }
  }

 private:
  static constexpr Slot MakeEmpty() {
    if constexpr (std::is_integral_v<Slot>) {
      return kNone32;
    } else {
      return Slot{};
    }
  }
  static constexpr Slot kEmpty = MakeEmpty();

  template <typename Is>
  size_t PlaceOf(uint64_t hash, const Is& is) const {
    const size_t mask = slots_.size() - 1;
    size_t i = hash >> shift_;
    while (!Empty(slots_[i]) && !is(slots_[i])) i = (i + 1) & mask;
    return i;
  }
  static size_t SizeFor(size_t least) { return std::bit_ceil(std::max<size_t>(least, 2)); }
  void SetShift() { shift_ = 64 - std::countr_zero(slots_.size()); }

  std::vector<Slot> slots_;
  int shift_ = 63;
};

}  // namespace mtdb::internal
