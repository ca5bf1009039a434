// SPDX-License-Identifier: Apache-2.0
// ClusterCache: the decoded units of one surface, shared by its queries.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "query/cache/admission.h"
#include "query/cache/cache_memory.h"
#include "query/cache/cache_user.h"
#include "query/cache/loaders.h"
#include "query/cache/unit_load.h"
#include "store/base/status.h"
#include "store/base/threading.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// Keeps decoded units within a budget of bytes; the least recently used go first. A unit is pinned
// while a caller holds it: pinned units count and are never dropped. The budget is hard: what finds
// no room waits, or fails with kBudgetExceeded. A unit is decoded from its parents, which are
// loaded on the way, coarsest first; by one thread, however many want it. A source that does not
// answer at once is asked for all payloads that a load lacks, and for what readers name ahead, in
// batches; payloads that have come or are on their way count. In the implicit form payloads are
// kept, within half of the budget, and decoded units only while there is a reader, in what room is
// left. While there are readers whose answers may be larger than the budget, a unit that they used
// and that has to go is put into a file, and comes back from there without its parents. Safe for
// many threads; a hit costs one short critical section. Must outlive its readers and the pointers
// it gave.
class ClusterCache {
 public:
  ClusterCache(std::shared_ptr<ClusterSource> source, const CacheOptions& options);
  ~ClusterCache();
  ClusterCache(const ClusterCache&) = delete;
  ClusterCache& operator=(const ClusterCache&) = delete;

  // The decoded unit, pinned as long as the pointer lives; the index then has the rows
  // that ClusterSource promises with it. For callers that hold a few units; queries have a
  // UnitReader. Never waits for room. Errors: those of ClusterSource, kCorrupt of LoadUnit,
  // kBudgetExceeded when pinned units leave no room, kNoSpace without memory, kNotYet.
  Result<LoadedUnitPtr> Get(UnitId unit, LoadStats* stats);
  // Nobody wants the payloads that are on their way. Queries that wait for some ask again.
  void CancelReads();

  // Bytes of the units and payloads held now, pinned ones and those being decoded or on their way
  // included.
  size_t bytes() const {
    const MutexLock lock(mutex_);
    return memory_.budget.used();
  }
  // The most that bytes() has been.
  size_t peak_bytes() const {
    const MutexLock lock(mutex_);
    return memory_.budget.peak();
  }
  // Units decoded since the cache was made; those that came back from a file do not count.
  uint64_t decoded() const {
    const MutexLock lock(mutex_);
    return memory_.decoded;
  }
  // True when nobody holds a unit, decodes one or waits for room.
  bool idle() const {
    const MutexLock lock(mutex_);
    return admission_.idle() && memory_.units.idle();
  }

  // For readers; what needs the mutex they do by a LockedCache. A query begins, and ends.
  void AddUser(const CacheUser& user);
  void RemoveUser(CacheUser& user);
  const CacheOptions& options() const { return memory_.options; }
  const ClusterIndex& index() const { return memory_.index; }
  const ObjectRecord& record() const { return memory_.source->record(); }
  bool at_once() const { return memory_.at_once; }  // how the source answers
  size_t TypicalBytes() const { return memory_.units.TypicalBytes(); }
  // Somebody waits until nobody holds units. Needs no mutex.
  bool awaited() const { return admission_.awaited(); }

 private:
  friend class LockedCache;
  Result<LoadedUnitPtr> GetPinned(UnitId unit, LoadStats* stats);
  Status Load(UnitId unit, LoadStats* stats, MutexLock& lock);
  void Unpin(UnitId unit);
  bool RunJob(const Loaders::Job& job, MutexLock& lock);
  void Arrive(const PayloadDesk::Batch& batch, UnitId unit, Result<Bytes> payload);

  mutable Mutex mutex_;
  Admission admission_;
  Loaders loaders_;
  CacheMemory memory_;
};

// A cache with its mutex held, for readers.
class LockedCache {
 public:
  explicit LockedCache(ClusterCache& cache)
      : cache_(cache), memory_(cache.memory_), lock_(cache.mutex_) {}

  const UnitTable& units() const { return memory_.units; }
  const PayloadDesk& payloads() const { return memory_.payloads; }
  const Spill& spill() const { return memory_.spill; }
  size_t used_bytes() const { return memory_.budget.used(); }
  Admission& admission() { return cache_.admission_; }
  Loaders& loaders() { return cache_.loaders_; }

  // Of a unit that is ready.
  void Pin(UnitId unit) { memory_.units.Pin(unit); }
  void Unpin(UnitId unit) { memory_.units.Unpin(unit); }
  // The unit leaves the cache first, and need not come back.
  void MakeOldest(UnitId unit) { memory_.units.MakeOldest(unit); }
  // Lets go of the mutex meanwhile, like all that follows.
  LoadOutcome Load(UnitId unit, const CacheUserPtr& user, Waiting waiting) {
    return LoadIntoMemory(unit, memory_, cache_.loaders_, user, waiting, lock_);
  }
  // kNotYet where nothing waits.
  Status WaitOn(ConditionVariable& changed, CacheUser& user);
  void Ask(std::span<const UnitId> units, const CacheUserPtr& user, Asking asking) {
    memory_.Ask(units, user, asking, lock_);
  }
  // Batches for which f(batch) is true are not wanted any more.
  template <typename F>
  void WithdrawIf(F&& f) {
    memory_.payloads.WithdrawIf(f);
    memory_.payloads.TellSource(lock_);
  }

  // As CacheMemory says.
  bool CanLoad(UnitId unit) const { return memory_.CanLoad(unit); }
  size_t UnitBudget() const { return memory_.UnitBudget(); }
  Status TooSmall(UnitId unit, size_t needed) const { return memory_.TooSmall(unit, needed); }
  Status NoRoom(UnitId unit, size_t bytes) const { return memory_.NoRoom(unit, bytes); }

 private:
  ClusterCache& cache_;
  CacheMemory& memory_;
  MutexLock lock_;
};

}  // namespace mtdb::internal
