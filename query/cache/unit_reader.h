// SPDX-License-Identifier: Apache-2.0
// UnitReader: how one query holds units of the cache.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/extract_stats.h"
#include "query/query_control.h"

namespace mtdb::internal {

class AvailableUnits;

// Holds the units that a step of a query works on. One thread. Waits for room only while it holds
// nothing, so that readers cannot wait for each other in a circle.
class UnitReader {
 public:
  using TimePoint = CacheUser::TimePoint;

  UnitReader(ClusterCache& cache, const ReaderLimits& limits);
  ~UnitReader();
  UnitReader(const UnitReader&) = delete;
  UnitReader& operator=(const UnitReader&) = delete;

  // The decoded unit, until Release. When it holds other units and there is no room, fails and says
  // crowded(): Release, WaitForRoom, and take the step again. Room is what the units that it holds
  // take, and the most that loading one of them into an empty cache takes beside; so which units a
  // reader may hold, with the cache for itself, is told from the units alone. Errors: those of
  // ClusterCache::Get; kCancelled; kBudgetExceeded when the unit and what is held do not fit the
  // cache, when max_bytes would be exceeded (out_of_bytes) and when the deadline is over
  // (out_of_time).
  Result<const LoadedUnit*> Get(UnitId unit);
  // Lets go of all units.
  void Release();
  // A unit that this reader has let go of and will not want again.
  void Forget(UnitId unit);
  // For what the reader will want again beside these units; null when the cache has room for all
  // of them, and when the reader does not spill.
  std::shared_ptr<SpillFile> SpillBeside(std::span<const UnitId> units) const;
  // Not null: a reader that waits for nothing. Its Get fails with kNotYet for what is missing, and
  // is never crowded; Release keeps what was got.
  AvailableUnits* available() const { return available_.get(); }
  // True when the unit can be got, for a reader that waits as well.
  bool IsAvailable(UnitId unit);
  // With nothing held: waits until nobody else holds units, and keeps it so until Release.
  Status WaitForRoom();
  // Units that will be wanted soon, by and by: other threads load them. Cheap when they are there.
  void Prefetch(std::span<const UnitId> units);
  // Prefetch asks a source that answers later.
  bool asks_ahead() const { return prefetch_units_ > 0 && !cache_.at_once(); }
  // Whether it is decoded.
  bool IsReady(UnitId unit) const { return LockedCache(cache_).units().ready(unit); }
  // How many units ahead a caller should name.
  size_t prefetch_units() const { return prefetch_units_; }

  bool crowded() const { return crowded_; }
  bool out_of_bytes() const { return user_->out_of_bytes; }
  bool out_of_time() const { return user_->out_of_time; }
  // kCancelled when the caller asked to stop; notes when the deadline is over.
  Status Check() { return user_->Check(); }
  void SetDeadline(std::optional<TimePoint> deadline) { user_->deadline = deadline; }

  // With max_bytes: false when they do not allow what has to be read before the unit can be held.
  bool MayRead(UnitId unit) const;
  // True when it should let go after this step: others wait, or it holds much.
  bool ShouldRelease() const;
  LoadStats stats() const;
  // Sets what `stats` says of reading, loading and the cache.
  void FillStats(ExtractStats* stats) const;

 private:
  // Pins the unit, loads it where it is not ready, and holds it; kBudgetExceeded, too, when the
  // cache could not hold it at all times.
  LoadOutcome Hold(UnitId unit, LockedCache& cache);

  ClusterCache& cache_;
  const CacheUserPtr user_;
  std::unique_ptr<AvailableUnits> available_;
  size_t prefetch_units_ = 0;
  Holding held_;
  std::vector<bool> seen_;  // per unit: wanted before
  bool crowded_ = false;
};

}  // namespace mtdb::internal
