// SPDX-License-Identifier: Apache-2.0
// BudgetCut: keeps a moving cut within a budget of triangles.
#pragma once

#include <cstdint>

#include "query/internal/levels.h"
#include "query/internal/moving_cut.h"
#include "query/internal/unit_reader.h"
#include "query/query.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// The cut of a query with max_triangles is the least cut for the last cutoff that fits, and cutoffs
// form a line (Levels, Cutoff). So it is found from where the last query ended: forth while there
// is room, back while there is none. Only where that is far away does a search find it from the
// root.
class BudgetCut {
 public:
  explicit BudgetCut(const ClusterSource& source) : source_(source) {}

  // Moves `cut` to that of the query, whose other budgets are not observed. On an error `cut` may
  // have moved, and the next call begins with a search.
  Status Move(UnitReader& reader, const Query& query, MovingCut* cut);

  // Of the last move: whether the budget ended it; nodes that were looked at.
  bool ended_by_budget() const { return position_ < end_; }
  uint64_t evaluated() const { return evaluated_; }

 private:
  // Places on the line of cutoffs: the root is at 0, the cut without a budget at `end_`.
  Cutoff CutoffAt(uint64_t position) const;
  uint64_t PositionOf(const Cutoff& cutoff) const;
  Status To(uint64_t position);
  Status Search();
  // From a position that is near.
  Status Adjust();
  // How many steps so many triangles are about; at least 1.
  uint64_t StepsFor(uint64_t triangles) const;
  bool Fits() const { return cut_->counts().triangles <= most_; }

  const ClusterSource& source_;
  bool known_ = false;  // position_ is where `cut` is
  bool in_pixels_ = false;
  int top_ = 0;
  uint64_t end_ = 0;
  uint64_t position_ = 0;
  double per_step_ = 0;  // triangles for a step on the line, as it was last
  uint64_t evaluated_ = 0;
  // During a move.
  UnitReader* reader_ = nullptr;
  const Query* query_ = nullptr;
  MovingCut* cut_ = nullptr;
  uint64_t most_ = 0;
};

}  // namespace mtdb::internal
