// SPDX-License-Identifier: Apache-2.0
// Admission: who may hold units, how many, and when.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "store/base/ids.h"
#include "store/base/out_of_memory.h"
#include "store/base/status.h"
#include "store/base/threading.h"

namespace mtdb::internal {

// What one reader holds.
struct Holding {
  // A unit that is there by chance may be gone the next time. What may be held together must not
  // depend on that: each of the units finds room to be loaded anew beside the others. So a cache
  // needs that many bytes, with one unit more of which `more` is held.
  size_t NeededWith(size_t more, size_t more_overhead) const {
    return bytes + more + std::max(overhead, more_overhead);
  }
  // Needs no memory when `units` has room for one more.
  void Add(UnitId unit, size_t more, size_t more_overhead) {
    units.push_back(unit);
    bytes += more;
    overhead = std::max(overhead, more_overhead);
  }
  // Keeps the memory of `units`.
  void Clear() {
    units.clear();
    bytes = overhead = 0;
    alone = false;
  }
  // It counts as a holder.
  bool inside() const { return alone || !units.empty(); }

  std::vector<UnitId> units;
  size_t bytes = 0;     // of these
  size_t overhead = 0;  // the largest of these: what loading one takes beside it
  bool alone = false;   // nobody else holds units
};

// Readers come in by a door. Who needs more room than there is beside others waits, holding
// nothing, until nobody holds units; meanwhile the door is closed, and whoever is inside leaves
// after a step without waiting for room. So nobody waits in a circle. Guarded by the cache's mutex;
// `wait` lets go of it: wait(changed) returns when the condition may have changed, or says why it
// does not wait.
class Admission {
 public:
  // Somebody has the cache for himself, or waits for that: he goes first.
  bool closed() const { return alone_ || waiting_ > 0; }
  // Without the mutex: whoever holds units should let go of them.
  bool awaited() const { return waiting_ > 0; }
  // Nobody is inside or waits to be alone.
  bool idle() const { return holders_ == 0 && !closed(); }

  // Goes in when the door is open.
  template <typename Wait>
  Status Enter(Wait&& wait) {
    while (closed()) MTDB_RETURN_IF_ERROR(wait(changed_));
    Enter();
    return Status::Ok();
  }
  // Goes in; of those who do not wait while they are inside, and hold few units.
  void Enter() { ++holders_; }
  void Leave() {
    --holders_;
    if (waiting_ > 0) changed_.notify_all();
  }
  // Goes in when nobody else is; of one who is not inside.
  template <typename Wait>
  Status EnterAlone(Wait&& wait) {
    ++waiting_;
    Status status;
    while (status.ok() && (alone_ || holders_ > 0)) {
      status = CatchOutOfMemory([&]() -> Status { return wait(changed_); });
    }
    --waiting_;
    if (status.ok()) {
      alone_ = true;
      Enter();
    } else {
      changed_.notify_all();
    }
    return status;
  }
  void LeaveAlone() {
    alone_ = false;
    changed_.notify_all();
    Leave();
  }

 private:
  ConditionVariable changed_;
  uint32_t holders_ = 0;              // readers that hold units, loads under way
  std::atomic<uint32_t> waiting_{0};  // readers that wait until nobody holds any
  bool alone_ = false;                // one reader has the cache for itself
};

}  // namespace mtdb::internal
