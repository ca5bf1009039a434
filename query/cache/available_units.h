// SPDX-License-Identifier: Apache-2.0
// AvailableUnits: the units that a query holds which takes what is there.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/extract_stats.h"

namespace mtdb::internal {

// Units that are missing, each once, and why.
class MissingUnits {
 public:
  using Reason = MissingCluster::Reason;
  explicit MissingUnits(uint32_t units) : noted_(units) {}

  void Note(UnitId unit, Reason reason);
  void Clear();
  bool Has(UnitId unit) const { return noted_[unit]; }
  // In no order.
  std::span<const UnitId> list() const { return list_; }
  Reason reason(UnitId unit) const;

 private:
  std::vector<bool> noted_;  // per unit: in list_
  std::vector<UnitId> list_;
  std::unordered_map<UnitId, Reason> reasons_;  // but for kNotRead
};

// A unit is available when it is decoded, or can be decoded now, when there is room to keep it, and
// when all that it comes from is available. What was taken is kept, with what it comes from, until
// its owner lets go of it; so no step has to wait for what an earlier one had. Nothing here waits:
// what is not there is noted as missing, and stays so until the next call begins. With threads of
// the cache's own these read and decode; without them Take decodes, and reads from sources that
// answer at once. One thread.
class AvailableUnits {
 public:
  using TimePoint = CacheUser::TimePoint;

  AvailableUnits(ClusterCache& cache, CacheUserPtr user);
  ~AvailableUnits();
  AvailableUnits(const AvailableUnits&) = delete;
  AvailableUnits& operator=(const AvailableUnits&) = delete;

  // A call of the caller begins: what was missing is looked for again, and what the cache does is
  // counted anew. After `until` Take decodes nothing, but for one unit a call.
  void Begin(QueryControl* control, std::optional<TimePoint> until);
  // The call is over, and with it its control; what was asked for stays on its way.
  void End();
  // Since Begin: what was there, and there was no time to decode.
  bool out_of_time() const { return out_of_time_; }
  // The time of the call begins now: what came before is not counted.
  void BeginRefining();
  bool time_is_over() const { return until_ && std::chrono::steady_clock::now() >= *until_; }

  // The unit, or kNotYet: then it is missing. Errors: those of memory.
  Result<const LoadedUnit*> Take(UnitId unit);
  // All pieces of the root, which are asked for at one time. Errors: that of one that failed,
  // kBudgetExceeded without room for them, kNotYet.
  Status TakeRoot();
  // What was taken and is kept; null: not this one.
  const LoadedUnit* Find(UnitId unit) const { return taken_[unit]; }
  // Lets go of all but these, those of Hold, and what they come from.
  void KeepOnly(std::span<const UnitId> units);
  // From now on KeepOnly keeps these, too.
  void Hold(std::vector<UnitId> units) { held_ = std::move(units); }

  // Since Begin: what Take was asked for and did not find, and what that comes from. In no order.
  const MissingUnits& missing() const { return missing_; }
  // Of one that failed.
  Status failure(UnitId unit) const;
  // What has failed is looked for again.
  void ForgetFailures();

  // Has the source asked for these, the first before the others, as many as there will be room for.
  // With `all`, what was asked for before and is not among them is not wanted any more.
  void Ask(std::span<const UnitId> order, bool all);

 private:
  void TakeOne(UnitId unit, LockedCache& cache);
  // Why it is missing; nothing: it is ready, and pinned.
  std::optional<MissingUnits::Reason> Pin(UnitId unit, LockedCache& cache);
  Status Load(UnitId unit, LockedCache& cache);
  void PushJobs(std::span<const UnitId> order, const std::vector<bool>& wanted, LockedCache& cache);

  ClusterCache& cache_;
  const CacheUserPtr user_;
  const size_t most_bytes_;  // that is kept; the rest of the budget is for what is on its way
  std::optional<TimePoint> until_;
  TimePoint begun_;
  bool decoded_ = false;      // since Begin
  bool out_of_time_ = false;  // likewise
  uint64_t came_bytes_ = 0;   // of payloads, in the calls before, for the amount to ask for
  std::vector<UnitId> held_;
  std::vector<const LoadedUnit*> taken_;  // per unit
  std::vector<UnitId> list_;              // of these
  size_t bytes_ = 0;                      // likewise
  MissingUnits missing_;
  std::vector<UnitId> todo_;
};

}  // namespace mtdb::internal
