// SPDX-License-Identifier: Apache-2.0
// UnitQueue: the units of a cut that have work to do, coarsest first.
#pragma once

#include <set>
#include <vector>

#include "query/internal/cut_state.h"
#include "query/internal/judge.h"
#include "query/internal/missing_clusters.h"
#include "query/internal/unit_reader.h"

namespace mtdb::internal {

// What the work is, whoever takes a unit finds in it. One queue at a time for each cut.
class UnitQueue {
 public:
  bool empty() const { return units_.empty(); }
  void Add(CutUnit& u) {
    if (u.queued) return;
    units_.insert(&u);
    u.queued = true;
  }
  // A triangle that the unit removes has come or gone.
  void Add(CutUnit& u, Arc arc) {
    u.arrivals.push_back(arc);
    Add(u);
  }
  // The first, of a queue that is not empty.
  CutUnit& Take() {
    CutUnit& u = **units_.begin();
    units_.erase(units_.begin());
    u.queued = false;
    return u;
  }
  // Has units loaded that will be taken soon, but for the first. Over a source that answers later
  // that is done where the first has to be waited for: the more is asked for at a time, the fewer
  // requests it takes.
  void Prefetch(UnitReader& reader, const Judge& judge) {
    ahead_.clear();
    if (reader.asks_ahead()) {
      if (units_.empty() || reader.IsReady((*units_.begin())->id)) return;
      for (auto it = units_.begin(); it != units_.end() && ahead_.size() < kMostAsked; ++it) {
        ahead_.push_back((*it)->id);
      }
      AskForWanted(judge, ahead_, reader);
      return;
    }
    size_t window = reader.prefetch_units();
    for (auto it = units_.begin(); it != units_.end() && window > 0; ++it, --window) {
      CutUnit& u = **it;
      if (!u.prefetched && it != units_.begin()) ahead_.push_back(u.id);
      u.prefetched = true;
    }
    if (!ahead_.empty()) reader.Prefetch(ahead_);
  }
  void Clear() { units_.clear(); }

 private:
  struct Coarser {
    bool operator()(const CutUnit* a, const CutUnit* b) const { return a->id > b->id; }
  };
  static constexpr size_t kMostAsked = 512;
  std::set<CutUnit*, Coarser> units_;
  std::vector<UnitId> ahead_;
};

}  // namespace mtdb::internal
