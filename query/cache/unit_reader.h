// SPDX-License-Identifier: Apache-2.0
// UnitReader: how one query holds units of the cache.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/extract_stats.h"
#include "query/query_control.h"

namespace mtdb::internal {

class AvailableUnits;

struct ReaderLimits {
  QueryControl* control = nullptr;
  // To read from the source. Root pieces are read in any case, and count.
  std::optional<uint64_t> max_bytes;
  // Holds what is there, and keeps it; see available().
  bool available_only = false;
  // Goes over its units several times: what has to leave the cache meanwhile is put into a file.
  bool spills = false;
};

// Holds the units that a step of a query works on. One thread. Waits for room only while it holds
// nothing, so that readers cannot wait for each other in a circle.
class UnitReader {
 public:
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
  void Forget(UnitId unit) { cache_.Forget(unit, *client_); }
  // True when the cache has room for all of them.
  bool Fit(std::span<const UnitId> units) const;
  // For what the reader will want again beside units; null when it does not spill.
  std::shared_ptr<SpillFile> spill_file() const;
  // Not null: a reader that waits for nothing. Its Get fails with kNotYet for what is missing, and
  // is never crowded; Release keeps what was got.
  AvailableUnits* available() const { return available_.get(); }
  // True when the unit can be got, for a reader that waits as well.
  bool IsAvailable(UnitId unit);
  // A call begins, of a reader that outlives them.
  void BeginCall(QueryControl* control, std::optional<std::chrono::steady_clock::time_point> until);
  // With nothing held: waits until nobody else holds units, and keeps it so until Release.
  Status WaitForRoom();
  // Units that will be wanted soon, by and by: other threads load them. Cheap when they are there.
  void Prefetch(std::span<const UnitId> units);
  // Prefetch asks a source that answers later.
  bool asks_ahead() const { return prefetch_units_ > 0 && !cache_.at_once_; }
  // Whether it is decoded.
  bool IsReady(UnitId unit);
  // How many units ahead a caller should name.
  size_t prefetch_units() const { return prefetch_units_; }

  bool crowded() const { return crowded_; }
  bool out_of_bytes() const { return out_of_bytes_; }
  bool out_of_time() const { return out_of_time_; }
  // kCancelled when the caller asked to stop; notes when the deadline is over.
  Status Check();
  void SetDeadline(std::optional<std::chrono::steady_clock::time_point> deadline) {
    deadline_ = deadline;
  }

  // Bytes to be read before the unit can be held.
  uint64_t BytesToRead(UnitId unit) const;
  uint64_t bytes_left() const;
  // True when it should let go after this step: others wait, or it holds much.
  bool ShouldRelease() const;
  LoadStats stats() const;
  // Sets what `stats` says of reading, loading and the cache.
  void FillStats(ExtractStats* stats) const;

 private:
  friend class ClusterCache;
  Status Enter(ClusterCache::Lock& lock);
  // Holds a unit that is pinned; kBudgetExceeded when the cache could not hold it at all times.
  Status Admit(UnitId unit);
  void NoteLoad();
  // Waits for a change, or a little when there is something to watch. kNotYet where nothing waits.
  Status WaitOn(ConditionVariable& changed, ClusterCache::Lock& lock) const;
  // Of units to be read in this order, those that max_bytes allows. With the cache's mutex held.
  void CutToLimit(std::vector<UnitId>& units) const;
  // The error of what max_bytes does not allow.
  Status OverLimit(UnitId unit);
  uint64_t BytesLeft() const;

  ClusterCache& cache_;
  ReaderLimits limits_;
  std::optional<std::chrono::steady_clock::time_point> deadline_;
  const ClusterCache::ClientPtr client_;
  std::unique_ptr<AvailableUnits> available_;
  size_t prefetch_units_ = 0;
  std::vector<UnitId> held_;
  std::vector<bool> seen_;  // per unit: wanted before
  // With max_bytes: what was read, so that nothing is read twice.
  std::unordered_map<UnitId, ClusterCache::Payload> payloads_;
  size_t held_bytes_ = 0;
  size_t held_overhead_ = 0;  // the largest of what is held
  bool exclusive_ = false;
  bool crowded_ = false;
  bool out_of_bytes_ = false;
  bool out_of_time_ = false;
};

}  // namespace mtdb::internal
