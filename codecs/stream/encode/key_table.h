// SPDX-License-Identifier: Apache-2.0
// KeyTable: a sender's numbers for things, and the slots that the things have.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "codecs/stream/internal/memory_bytes.h"
#include "store/base/ids.h"
#include "store/base/open_table.h"

namespace mtdb::internal {

// Keys that follow each other lie in one page: what a node creates has such keys, and comes and
// goes together. Pages are found by a hash table of their
// numbers; for each slot there is the number and the place of its key.
class KeyTable {
 public:
  // The slot of a key, or kNone32.
  uint32_t Find(uint64_t key) const {
    const uint32_t page = FindPage(key / kPage);
    return page == kNone32 ? kNone32 : pages_[page].slots[key % kPage];
  }
  // Of a slot that is there.
  uint64_t key(uint32_t slot) const {
    return pages_[places_[slot] / kPage].number * kPage + places_[slot] % kPage;
  }
  // The slot is not there. If the key is, it gets another slot.
  void Put(uint64_t key, uint32_t slot) {
    // What is put together mostly lies in the page of the last one.
    if (last_ == kNone32 || pages_[last_].number != key / kPage) last_ = TakePage(key / kPage);
    if (slot >= places_.size()) [[unlikely]]
      ResizeTight(places_, slot + size_t{1});
    places_[slot] = static_cast<uint32_t>(last_ * kPage + key % kPage);
    Page& page = pages_[last_];
    uint32_t& at = page.slots[key % kPage];
    page.used += at == kNone32 ? 1 : 0;
    at = slot;
  }
  // The slot is there.
  void Erase(uint32_t slot) {
    const uint32_t page = places_[slot] / kPage;
    pages_[page].slots[places_[slot] % kPage] = kNone32;
    if (--pages_[page].used == 0) GiveUp(page);
  }
  // Slots that are there, ascending.
  std::vector<uint32_t> Slots() const {
    std::vector<uint32_t> slots;
    for (const Page& page : pages_) {
      std::copy_if(page.slots.begin(), page.slots.end(), std::back_inserter(slots),
                   [](uint32_t slot) { return slot != kNone32; });
    }
    std::sort(slots.begin(), slots.end());
    return slots;
  }
  // Asks for the memory that a search begins with, and when that is there for what it ends with.
  [[gnu::always_inline]] void Prefetch(uint64_t key) const {
    if (table_.size() != 0) __builtin_prefetch(&table_.Home(HashOfNumber(key / kPage)));
  }
  [[gnu::always_inline]] void PrefetchPage(uint64_t key) const {
    if (table_.size() == 0) return;
    const uint32_t page = table_.Home(HashOfNumber(key / kPage));
    if (page != kNone32) __builtin_prefetch(&pages_[page].slots[key % kPage]);
  }
  // Likewise of the key of a slot that is there.
  [[gnu::always_inline]] void PrefetchPlace(uint32_t slot) const {
    __builtin_prefetch(&places_[slot]);
  }
  [[gnu::always_inline]] void PrefetchPlacePage(uint32_t slot) const {
    __builtin_prefetch(&pages_[places_[slot] / kPage].slots[places_[slot] % kPage]);
  }
  size_t memory_bytes() const {
    return CapacityBytes(pages_) + CapacityBytes(free_) + table_.memory_bytes() +
           CapacityBytes(places_);
  }

 private:
  static constexpr uint64_t kPage = 16;  // keys
  struct Page {
    uint64_t number = 0;  // its keys over kPage
    uint32_t used = 0;
    std::array<uint32_t, kPage> slots;  // kNone32: the key is not there
  };

  struct HashOfPage {
    const std::vector<Page>& pages;
    uint64_t operator()(uint32_t page) const { return HashOfNumber(pages[page].number); }
  };
  // Where the page is in the table, or would be.
  template <typename Table>
  static auto& PlaceIn(Table& table, const std::vector<Page>& pages, uint64_t number) {
    return table.Find(HashOfNumber(number), [&](uint32_t p) { return pages[p].number == number; });
  }
  uint32_t FindPage(uint64_t number) const {
    return table_.size() == 0 ? kNone32 : PlaceIn(table_, pages_, number);
  }
  uint32_t TakePage(uint64_t number) {
    if (2 * (pages_.size() - free_.size() + 1) > table_.size()) {
      table_.Resize(std::max<size_t>(16, 2 * table_.size()), HashOfPage{pages_});
    }
    uint32_t& page = PlaceIn(table_, pages_, number);
    if (page == kNone32) {
      if (free_.empty()) {
        page = static_cast<uint32_t>(pages_.size());
        ResizeTight(pages_, pages_.size() + 1);
      } else {
        page = free_.back();
        free_.pop_back();
      }
      pages_[page].number = number;
      pages_[page].slots.fill(kNone32);
    }
    return page;
  }
  void GiveUp(uint32_t page) {
    if (page == last_) last_ = kNone32;
    table_.Erase(PlaceIn(table_, pages_, pages_[page].number), HashOfPage{pages_});
    free_.push_back(page);
  }
  std::vector<Page> pages_;
  std::vector<uint32_t> free_;    // of pages_
  OpenTable<uint32_t> table_;     // pages, at most half full
  std::vector<uint32_t> places_;  // by slot: page * kPage + place
  uint32_t last_ = kNone32;       // the page that was put into last, while it is used
};

}  // namespace mtdb::internal
