// SPDX-License-Identifier: Apache-2.0
// AvailableUnits: the units that a query holds which takes what is there.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/extract_stats.h"

namespace mtdb::internal {

// A unit is available when it is decoded, or can be decoded now, when there is room to keep it, and
// when all that it comes from is available. What was taken is kept, with what it comes from, until
// its owner lets go of it; so no step has to wait for what an earlier one had. Nothing here waits:
// what is not there is noted as missing, and stays so until the next call begins. With threads of
// the cache's own these read and decode; without them Take decodes, and reads from sources that
// answer at once. One thread.
class AvailableUnits {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  AvailableUnits(ClusterCache& cache, ClusterCache::ClientPtr client);
  ~AvailableUnits();
  AvailableUnits(const AvailableUnits&) = delete;
  AvailableUnits& operator=(const AvailableUnits&) = delete;

  // A call of the caller begins: what was missing is looked for again. After `until` Take decodes
  // nothing, but for one unit a call.
  void Begin(std::optional<TimePoint> until);
  // Payloads that came in the calls before, for the amount to ask for.
  void CountBytes(uint64_t bytes) { came_bytes_ += bytes; }
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
  bool taken(UnitId unit) const { return taken_[unit] != nullptr; }
  // What was taken and is kept; null: not this one.
  const LoadedUnit* Find(UnitId unit) const { return taken_[unit]; }
  // Lets go of all but these, those of Hold, and what they come from.
  void KeepOnly(std::span<const UnitId> units);
  // From now on KeepOnly keeps these, too.
  void Hold(std::vector<UnitId> units) { held_ = std::move(units); }

  // Since Begin: what Take was asked for and did not find, and what that comes from. In no order.
  std::span<const UnitId> missing() const { return missing_; }
  bool missing(UnitId unit) const { return noted_[unit]; }
  // Why, of a missing unit.
  MissingCluster::Reason reason(UnitId unit) const;
  // Of one that failed.
  Status failure(UnitId unit) const;
  // What has failed is looked for again.
  void ForgetFailures();

  // Has the source asked for these, the first before the others, as many as there will be room for.
  // With `all`, what was asked for before and is not among them is not wanted any more.
  void Ask(std::span<const UnitId> order, bool all);

 private:
  void TakeOne(UnitId unit, ClusterCache::Lock& lock);
  Status Load(UnitId unit, ClusterCache::Lock& lock);
  void Note(UnitId unit, MissingCluster::Reason reason);
  bool HasWorkers() const;
  void WithdrawUnwanted(const std::vector<bool>& wanted);
  void PushJobs(std::span<const UnitId> order);

  ClusterCache& cache_;
  const ClusterCache::ClientPtr client_;
  const size_t most_bytes_;  // that is kept; the rest of the budget is for what is on its way
  std::optional<TimePoint> until_;
  TimePoint begun_;
  bool decoded_ = false;      // since Begin
  bool out_of_time_ = false;  // likewise
  uint64_t came_bytes_ = 0;   // of payloads, in the calls before
  std::vector<UnitId> held_;
  std::vector<const LoadedUnit*> taken_;  // per unit
  std::vector<UnitId> list_;              // of these
  size_t bytes_ = 0;                      // likewise
  std::vector<bool> noted_;               // per unit: in missing_
  std::vector<UnitId> missing_;
  std::unordered_map<UnitId, MissingCluster::Reason> reasons_;  // but for kNotRead
  std::vector<UnitId> todo_;
};

}  // namespace mtdb::internal
