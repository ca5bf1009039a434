// SPDX-License-Identifier: Apache-2.0
#include "query/cache/cluster_cache.h"

#include <algorithm>
#include <utility>

#include "query/fields/stopwatch.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {

// Why nobody waits forever. A thread that has claimed a unit reads and decodes it without waiting
// for anything, so waiting for a claimed unit ends. Waiting for a payload that is on its way ends
// as the source answers every unit; whoever takes it off its way wakes all, who then ask for it
// themselves. Payloads that a plan has yet to decode are dropped by that plan only, so that plans
// cannot take them from each other without end. Room is waited for in two places only, by readers
// that hold nothing: at the door, and to be alone (admission.h). Who waits to be alone closes the
// door; whoever is inside holds units, does not wait for room (what finds none fails), and lets go
// after a step. So it becomes the only holder, all else can be dropped, and what finds no room then
// never will.
//
// Nor when memory runs out: with mutex_ held, what has been counted or pinned or claimed belongs to
// something whose destructor takes it back (LoadPlan, Claimed, Evicted), or nothing that needs
// memory follows.
//
// mutex_ is not held while the source is called. Answers hold the door of the desk, then mutex_.

ClusterCache::ClusterCache(std::shared_ptr<ClusterSource> source, const CacheOptions& options)
    : loaders_(mutex_, std::max(options.threads, 1u) - 1,
               [this](const Loaders::Job& job, MutexLock& lock) { return RunJob(job, lock); }),
      memory_(std::move(source), options,
              [this](const PayloadDesk::Batch& batch, UnitId unit, Result<Bytes> payload) {
                Arrive(batch, unit, std::move(payload));
              }) {}

ClusterCache::~ClusterCache() { loaders_.Stop(); }

Result<LoadedUnitPtr> ClusterCache::Get(UnitId unit, LoadStats* stats) {
  return CatchOutOfMemory([&] { return GetPinned(unit, stats); });
}

Result<LoadedUnitPtr> ClusterCache::GetPinned(UnitId unit, LoadStats* stats) {
  const LoadedUnit* value = nullptr;
  {
    std::vector<LoadedUnitPtr> idle;
    MutexLock lock(mutex_);
    MTDB_CHECK(unit < memory_.units.size(), "no such cluster or root piece");
    if (memory_.units.ready(unit)) {
      memory_.units.Pin(unit);
    } else {
      const Status loaded = Load(unit, stats, lock);
      idle = memory_.DropIdle();
      MTDB_RETURN_IF_ERROR(loaded);
    }
    value = memory_.units[unit].value.get();
  }
  // Also unpins when there is no memory for the pointer.
  return LoadedUnitPtr(value, [this, unit](const LoadedUnit*) { Unpin(unit); });
}

Status ClusterCache::Load(UnitId unit, LoadStats* stats, MutexLock& lock) {
  const Stopwatch watch;
  const auto user =
      std::make_shared<CacheUser>(memory_.source->record(), memory_.units.size(), ReaderLimits{});
  user->stats = *stats;
  admission_.Enter();
  LoadOutcome loaded = LoadIntoMemory(unit, memory_, loaders_, user, Waiting::kAnyhow, lock);
  admission_.Leave();
  *stats = user->stats;
  stats->seconds += watch.Seconds();
  return std::move(loaded.status);
}

void ClusterCache::Unpin(UnitId unit) {
  std::vector<LoadedUnitPtr> idle;
  const MutexLock lock(mutex_);
  memory_.units.Unpin(unit);
  idle = memory_.DropIdle();
}

void ClusterCache::CancelReads() {
  LockedCache(*this).WithdrawIf([](const auto&) { return true; });
}

// Does not wait for room: a unit that finds none is left to the query.
bool ClusterCache::RunJob(const Loaders::Job& job, MutexLock& lock) {
  CacheUser& user = *job.user;
  if (user.over || user.done[job.unit] || admission_.closed() || !memory_.units.empty(job.unit)) {
    return false;
  }
  admission_.Enter();
  const Waiting waiting = memory_.at_once ? Waiting::kAnyhow : Waiting::kNever;
  const LoadOutcome loaded = LoadIntoMemory(job.unit, memory_, loaders_, job.user, waiting, lock);
  const StatusCode code = loaded.status.code();
  if (loaded.status.ok()) {
    memory_.units.Unpin(job.unit);
  } else if (user.limits.available_only && code != StatusCode::kNotYet) {
    // It asks for nothing that has failed, and for room when there is more of it.
    static_cast<void>(TryAllocate([&] {
      if (loaded.no_room) {
        user.no_room[job.unit] = memory_.budget.used();
      } else {
        user.failures[job.unit] = loaded.status;
      }
    }));
  }
  admission_.Leave();
  static_cast<void>(memory_.DropIdle());  // when the query is over meanwhile
  return true;
}

void ClusterCache::Arrive(const PayloadDesk::Batch& batch, UnitId unit, Result<Bytes> payload) {
  MutexLock lock(mutex_);
  if (!memory_.payloads.TakeOff(batch, unit)) return;  // withdrawn
  const CacheUserPtr user = batch.user;
  Evicted evicted(memory_);
  const Status status =
      CatchOutOfMemory([&] { return memory_.Accept(unit, std::move(payload), *user, evicted); });
  if (!status.ok()) static_cast<void>(TryAllocate([&] { user->failures[unit] = status; }));
  memory_.changed.notify_all();
  if (batch.asking != Asking::kToWait && memory_.payloads.Find(unit) != nullptr && !user->over) {
    static_cast<void>(TryAllocate([&] { loaders_.Push(unit, user); }));
    loaders_.Wake();
  }
  memory_.LetGo(evicted, lock);
}

void ClusterCache::AddUser(const CacheUser& user) {
  const MutexLock lock(mutex_);
  memory_.AddReader(user.limits.spills);
}

// What the last reader leaves behind goes back to the system.
void ClusterCache::RemoveUser(CacheUser& user) {
  CacheMemory::Rest rest;
  MutexLock lock(mutex_);
  user.over = true;
  user.limits.control = nullptr;
  // What nobody will wait for need not come. Who does not wait, or takes what is there, comes back
  // for it.
  if (options().waits && !user.limits.available_only) {
    memory_.payloads.WithdrawIf([&](const auto& batch) { return batch.user.get() == &user; });
  }
  memory_.payloads.TellSource(lock);
  memory_.RemoveReader(user.limits.spills, rest);
}

Status LockedCache::WaitOn(ConditionVariable& changed, CacheUser& user) {
  if (!memory_.options.waits) {
    return NotYet(user.record.name + ": other queries hold the cache; ask again");
  }
  return user.WaitOn(changed, lock_);
}

}  // namespace mtdb::internal
