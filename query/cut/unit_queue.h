// SPDX-License-Identifier: Apache-2.0
// UnitQueue: the units of a cut that have work to do, coarsest first.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <vector>

#include "query/cache/unit_reader.h"
#include "query/cut/cut_state.h"
#include "query/cut/judge.h"
#include "query/cut/missing_clusters.h"

namespace mtdb::internal {

// What the work is, whoever takes a unit finds in it. One queue at a time for each cut.
class UnitQueue {
 public:
  explicit UnitQueue(const CutState& cut) : cut_(cut), words_(cut.index().unit_count() / 64 + 1) {}

  bool empty() const { return size_ == 0; }
  void Add(CutUnit& u) {
    if (u.queued) return;
    words_[u.id / 64] |= uint64_t{1} << (u.id % 64);
    first_ = std::max(first_, size_t{u.id / 64});
    ++size_;
    u.queued = true;
  }
  // A triangle that the unit removes has come or gone.
  void Add(CutUnit& u, Arc arc) {
    u.arrivals.push_back(arc);
    Add(u);
  }
  // The first, of a queue that is not empty.
  CutUnit& Take() {
    CutUnit& u = First();
    words_[first_] &= ~(uint64_t{1} << (u.id % 64));
    --size_;
    u.queued = false;
    return u;
  }
  // Has units loaded that will be taken soon, but for the first. Over a source that answers later
  // that is done where the first has to be waited for: the more is asked for at a time, the fewer
  // requests it takes.
  void Prefetch(UnitReader& reader, const Judge& judge) {
    ahead_.clear();
    if (reader.asks_ahead()) {
      if (empty() || reader.IsReady(First().id)) return;
      ForEach(kMostAsked, [&](CutUnit& u) { ahead_.push_back(u.id); });
      AskForWanted(judge, ahead_, reader);
      return;
    }
    bool first = true;
    ForEach(reader.prefetch_units(), [&](CutUnit& u) {
      if (!u.prefetched && !first) ahead_.push_back(u.id);
      u.prefetched = true;
      first = false;
    });
    if (!ahead_.empty()) reader.Prefetch(ahead_);
  }
  void Clear() {
    std::fill(words_.begin(), words_.end(), 0);
    first_ = size_ = 0;
  }

 private:
  CutUnit& UnitAt(size_t word, uint64_t bits) const {
    return *cut_.Find(static_cast<UnitId>(word * 64 + 63) -
                      static_cast<UnitId>(std::countl_zero(bits)));
  }
  CutUnit& First() {
    while (words_[first_] == 0) --first_;
    return UnitAt(first_, words_[first_]);
  }
  // The first ones, `most` at most.
  template <typename F>
  void ForEach(size_t most, F&& f) const {
    most = std::min(most, size_);
    for (size_t word = first_; most > 0; --word) {
      for (uint64_t rest = words_[word]; rest != 0 && most > 0; --most) {
        CutUnit& u = UnitAt(word, rest);
        rest &= ~(uint64_t{1} << (u.id % 64));
        f(u);
      }
    }
  }

  static constexpr size_t kMostAsked = 512;
  const CutState& cut_;
  std::vector<uint64_t> words_;  // a bit for each unit of the object
  size_t first_ = 0;             // a word; those after it are 0
  size_t size_ = 0;
  std::vector<UnitId> ahead_;
};

}  // namespace mtdb::internal
