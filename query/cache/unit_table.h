// SPDX-License-Identifier: Apache-2.0
// UnitTable: which units are decoded, who holds them, and which was used last.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "query/cache/byte_budget.h"
#include "query/cache/loaded_unit.h"

namespace mtdb::internal {

// A unit is empty until a thread claims it, which loads it; then it is filled and ready, or empty
// again. Units that are ready and claimed count in the budget. Nothing here but the constructor and
// LoadBytes needs memory. Not safe for many threads: the cache's mutex guards it.
class UnitTable {
 public:
  enum class State : uint8_t { kEmpty, kClaimed, kReady };
  struct Entry {
    LoadedUnitPtr value;  // when kReady
    size_t bytes = 0;     // that count; an estimate while it is claimed
    // Of a unit that was decoded once; they stay.
    size_t decoded_bytes = 0;
    size_t overhead = 0;  // what a load into an empty cache takes at most beside that
    uint32_t pins = 0;
    uint32_t newer = kNone32;  // neighbours in the list of ready units by last use
    uint32_t older = kNone32;
    uint32_t used_in = 0;  // the last period in which it was pinned
    State state = State::kEmpty;
  };

  // With `payloads_count`, the payload of a unit is in the budget while it is decoded.
  UnitTable(const ObjectRecord& record, const ClusterIndex& index, bool payloads_count,
            ByteBudget& budget);

  uint32_t size() const { return static_cast<uint32_t>(entries_.size()); }
  const Entry& operator[](UnitId unit) const { return entries_[unit]; }
  bool empty(UnitId unit) const { return entries_[unit].state == State::kEmpty; }
  bool ready(UnitId unit) const { return entries_[unit].state == State::kReady; }
  // Nobody holds or loads one.
  bool idle() const {
    return std::ranges::all_of(entries_, [](const Entry& entry) {
      return entry.pins == 0 && entry.state != State::kClaimed;
    });
  }

  // Of an empty unit.
  void Claim(UnitId unit, size_t bytes) {
    entries_[unit].state = State::kClaimed;
    entries_[unit].bytes = bytes;
    budget_.Add(bytes);
  }
  // A unit that is claimed is empty again; others stay as they are.
  void Unclaim(UnitId unit) {
    Entry& entry = entries_[unit];
    if (entry.state != State::kClaimed) return;
    budget_.Remove(entry.bytes);
    entry.bytes = 0;
    entry.state = State::kEmpty;
  }
  // What was found when a claimed unit was decoded.
  void NoteSize(UnitId unit, size_t decoded_bytes);
  // Of a claimed unit.
  void Fill(UnitId unit, LoadedUnitPtr value) {
    entries_[unit].value = std::move(value);
    entries_[unit].state = State::kReady;
    Link(unit);
  }
  // Of a unit that is ready. While it is pinned it stays.
  void Pin(UnitId unit) {
    ++entries_[unit].pins;
    entries_[unit].used_in = period_;
    if (newest_ == unit) return;
    Unlink(unit);
    Link(unit);
  }
  void Unpin(UnitId unit) { --entries_[unit].pins; }
  // Of a unit that is ready: it is empty, and whoever takes the value destroys it.
  LoadedUnitPtr Drop(UnitId unit) {
    Entry& entry = entries_[unit];
    Unlink(unit);
    budget_.Remove(entry.bytes);
    entry.bytes = 0;
    entry.state = State::kEmpty;
    return std::move(entry.value);
  }
  // It goes first, and counts as not used in this period; where it is ready, and nobody holds it.
  void MakeOldest(UnitId unit) {
    Entry& entry = entries_[unit];
    if (entry.state != State::kReady || entry.pins > 0) return;
    entry.used_in = 0;
    if (oldest_ == unit) return;
    Unlink(unit);
    entry.older = kNone32;
    entry.newer = oldest_;
    entries_[oldest_].older = unit;
    oldest_ = unit;
  }
  // Calls f(unit), which may drop it, for each ready unit that nobody holds, the least recently
  // used first, until f returns false.
  template <typename F>
  void ForEachUnpinned(F&& f) {
    for (uint32_t unit = oldest_; unit != kNone32;) {
      const uint32_t next = entries_[unit].newer;
      if (entries_[unit].pins == 0 && !f(unit)) return;
      unit = next;
    }
  }
  // A period is the time in which somebody cares which units were used.
  void BeginPeriod() { ++period_; }
  bool UsedInPeriod(UnitId unit) const { return entries_[unit].used_in == period_; }

  // Bytes of the unit when decoded, guessed from the index.
  size_t EstimateBytes(UnitId unit) const;
  // Of a unit about which nothing is known.
  size_t TypicalBytes() const;
  // The largest estimate of all.
  size_t LargestEstimate() const;
  // What a load into an empty cache takes at most, when the unit and all that it comes from have
  // been decoded once: a unit at a time, coarsest first, each kept until its last child is decoded.
  size_t LoadBytes(UnitId unit) const;

 private:
  void Link(UnitId unit) {
    Entry& entry = entries_[unit];
    entry.newer = kNone32;
    entry.older = newest_;
    (newest_ == kNone32 ? oldest_ : entries_[newest_].newer) = unit;
    newest_ = unit;
  }
  void Unlink(UnitId unit) {
    const Entry& entry = entries_[unit];
    (entry.newer == kNone32 ? newest_ : entries_[entry.newer].older) = entry.older;
    (entry.older == kNone32 ? oldest_ : entries_[entry.older].newer) = entry.newer;
  }

  const ObjectRecord& record_;
  const ClusterIndex& index_;
  const bool payloads_count_;
  ByteBudget& budget_;
  std::vector<Entry> entries_;  // by unit
  uint32_t newest_ = kNone32;
  uint32_t oldest_ = kNone32;
  uint32_t period_ = 0;
};

}  // namespace mtdb::internal
