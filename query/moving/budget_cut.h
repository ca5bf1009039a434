// SPDX-License-Identifier: Apache-2.0
// BudgetCut: keeps a moving cut within a budget of triangles.
#pragma once

#include <cstdint>

#include "query/cache/unit_reader.h"
#include "query/cut/levels.h"
#include "query/moving/moving_cut.h"
#include "query/query.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// The cut of a query with max_triangles is the least cut for the last cutoff that fits, and cutoffs
// form a line (Levels, Cutoff). So it is found from where the last query ended: forth while there
// is room, back while there is none, each time by a move.
class BudgetCut {
 public:
  explicit BudgetCut(const ClusterSource& source) : source_(source) {}

  // Moves `cut` to that of the query, whose other budgets are not observed. With a reader that
  // waits for nothing it ends when the time is over, after a step at least; with `goes_on` it is
  // the query of the call before, which was not done. On an error `cut` may have moved.
  Status Move(UnitReader& reader, const Query& query, bool goes_on, MovingCut* cut);

  // Of the last move: whether it came to its end; whether the mesh fits.
  bool done() const { return done_; }
  bool fits() const { return fits_; }
  // Whether the budget ended it; nodes that were looked at.
  bool ended_by_budget() const { return position_ < end_; }
  uint64_t evaluated() const { return evaluated_; }

 private:
  // Places on the line of cutoffs: the root is at 0, the cut without a budget at `end_`.
  Cutoff CutoffAt(uint64_t position) const;
  Status To(uint64_t position, bool first);
  // After a step: false when it did not come to its end.
  bool Note();
  uint64_t Next() const;
  // About how many places away the budget is.
  uint64_t StepsAway() const;
  uint64_t units() const { return source_.index().unit_count(); }
  uint64_t triangles() const { return cut_->counts().triangles; }

  const ClusterSource& source_;
  bool in_pixels_ = false;
  int top_ = 0;
  uint64_t end_ = 0;
  uint64_t position_ = 0;
  uint64_t most_ = 0;
  // Of this query: the last place that is known to fit, the first that is known not to; how often
  // it was tried.
  struct {
    uint64_t good = 0;
    uint64_t too_far = 0;
    int tries = 0;
  } known_;
  bool done_ = false;
  bool fits_ = false;
  double per_place_ = 0;  // triangles, as it was last; 0: not known
  uint64_t evaluated_ = 0;
  // During a move.
  UnitReader* reader_ = nullptr;
  const Query* query_ = nullptr;
  MovingCut* cut_ = nullptr;
};

}  // namespace mtdb::internal
