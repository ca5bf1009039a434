// SPDX-License-Identifier: Apache-2.0
#include "query/moving/moving_units.h"

namespace mtdb::internal {

MovingUnit& MovingUnits::Open(UnitId id) {
  if (MovingUnit* const u = Find(id); u != nullptr) return *u;
  auto& u = static_cast<MovingUnit&>(Add(id, std::make_unique<MovingUnit>()));
  u.deadlines.Begin(UnitBounds(judge_, id), u.known, index().children(id).size());
  queue_.Add(u);
  return u;
}

void MovingUnits::UndoMove() {
  queue_.Clear();
  Undo();
  for (const UnitId id : open()) {
    MovingUnit& u = *Find(id);
    u.deadlines.stale = true;
    u.recheck = Bits();
    u.suspended = Bits();
    u.new_suspended.clear();
    u.undecided.clear();
    u.undecided_children.clear();
  }
}

}  // namespace mtdb::internal
