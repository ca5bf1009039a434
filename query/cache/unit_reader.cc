// SPDX-License-Identifier: Apache-2.0
#include "query/cache/unit_reader.h"

#include <algorithm>
#include <functional>
#include <unordered_set>

#include "query/cache/available_units.h"
#include "query/fields/make_room.h"
#include "query/fields/stopwatch.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {

namespace {

// What a query holds between steps takes at most this share of the cache.
constexpr size_t kHeldShare = 16;
// What is loaded ahead of a query takes at most this share of the cache.
constexpr size_t kPrefetchShare = 4;
constexpr size_t kPrefetchPerThread = 8;
constexpr size_t kAskedAhead = 64;  // of a source that answers later
// What is asked for ahead and has not been decoded takes at most this share.
constexpr size_t kAheadShare = 4;

// Asks for units that are wanted soon, and for their missing parents.
void AskAhead(std::span<const UnitId> units, const CacheUserPtr& user, const ClusterIndex& index,
              size_t budget_bytes, LockedCache& cache) {
  std::vector<UnitId> list;
  std::vector<bool> listed(index.unit_count());
  const auto add = [&](UnitId u) {
    if (listed[u] || !cache.units().empty(u)) return;
    listed[u] = true;
    list.push_back(u);
  };
  for (const UnitId u : units) add(u);
  size_t bytes = cache.payloads().bytes() + cache.payloads().bytes_on_their_way();
  for (size_t i = 0; i < list.size(); ++i) {
    if (!index.Has(list[i])) continue;
    bytes += index.location(list[i]).length;
    if (bytes > budget_bytes / kAheadShare) {
      list.resize(i);
      break;
    }
    for (const UnitId p : index.parents(list[i])) add(p);
  }
  std::ranges::sort(list, std::greater<>());
  cache.Ask(list, user, Asking::kAhead);
}

}  // namespace

UnitReader::UnitReader(ClusterCache& cache, const ReaderLimits& limits)
    : cache_(cache),
      user_(std::make_shared<CacheUser>(cache.record(), cache.index().unit_count(), limits)),
      seen_(cache.index().unit_count()) {
  const CacheOptions& options = cache.options();
  if (limits.available_only) {
    available_ = std::make_unique<AvailableUnits>(cache, user_);
  } else if ((options.threads > 1 || !cache.at_once()) && !limits.max_bytes) {
    const size_t most = cache.at_once() ? kPrefetchPerThread * options.threads : kAskedAhead;
    prefetch_units_ = std::min(most, options.budget_bytes / kPrefetchShare / cache.TypicalBytes());
  }
  cache.AddUser(*user_);
}

UnitReader::~UnitReader() {
  Release();
  available_.reset();
  cache_.RemoveUser(*user_);
}

bool UnitReader::IsAvailable(UnitId unit) {
  return available_ == nullptr || available_->Take(unit).ok();
}

// Whoever waits to be alone goes first.
Result<const LoadedUnit*> UnitReader::Get(UnitId unit) {
  crowded_ = false;
  if (available_ != nullptr) return available_->Take(unit);
  MakeRoomForOne(held_.units);
  for (;;) {
    const bool inside = held_.inside();
    {
      LockedCache cache(cache_);
      MTDB_CHECK(unit < seen_.size(), "no such cluster or root piece");
      const Stopwatch watch;
      if (!inside) {
        MTDB_RETURN_IF_ERROR(cache.admission().Enter(
            [&](ConditionVariable& changed) { return cache.WaitOn(changed, *user_); }));
      }
      const bool ready = cache.units().ready(unit);
      const LoadOutcome held = Hold(unit, cache);
      if (!ready) user_->stats.seconds += watch.Seconds();
      if (held.status.ok()) return cache.units()[unit].value.get();
      if (!inside) cache.admission().Leave();
      if (!held.no_room || inside) {
        crowded_ = held.no_room && (!held_.alone || !held_.units.empty());
        return held.status;
      }
    }
    MTDB_RETURN_IF_ERROR(WaitForRoom());
  }
}

LoadOutcome UnitReader::Hold(UnitId unit, LockedCache& cache) {
  const bool ready = cache.units().ready(unit);
  if (!seen_[unit]) {
    seen_[unit] = true;
    const bool there = (ready || cache.payloads().Find(unit) != nullptr) && !user_->read[unit];
    if (there && cache_.index().unit(unit).nodes > 0) ++user_->stats.clusters_cached;
  }
  if (ready) {
    cache.Pin(unit);
  } else {
    LoadOutcome loaded = cache.Load(unit, user_, held_.alone ? Waiting::kAlone : Waiting::kWatched);
    if (!loaded.status.ok()) return loaded;
  }
  const UnitTable::Entry& entry = cache.units()[unit];
  const size_t needed = held_.NeededWith(entry.bytes, entry.overhead);
  if (needed <= cache_.options().budget_bytes) {
    held_.Add(unit, entry.bytes, entry.overhead);
    return Status::Ok();
  }
  cache.Unpin(unit);
  return {CatchOutOfMemory([&] { return cache.TooSmall(unit, needed); }), !held_.units.empty()};
}

Status UnitReader::WaitForRoom() {
  MTDB_CHECK(held_.units.empty(), "who waits for room holds nothing");
  const Stopwatch watch;
  LockedCache cache(cache_);
  const Status status = cache.admission().EnterAlone(
      [&](ConditionVariable& changed) { return cache.WaitOn(changed, *user_); });
  held_.alone = status.ok();
  user_->stats.seconds += watch.Seconds();
  return status;
}

void UnitReader::Release() {
  if (!held_.inside()) return;
  LockedCache cache(cache_);
  for (const UnitId u : held_.units) cache.Unpin(u);
  if (held_.alone) {
    cache.admission().LeaveAlone();
  } else {
    cache.admission().Leave();
  }
  held_.Clear();
}

// When it is the only reader that spills, the unit need not be put into the file.
void UnitReader::Forget(UnitId unit) {
  LockedCache cache(cache_);
  user_->done[unit] = true;
  if (cache.spill().readers() < 2) cache.MakeOldest(unit);
}

std::shared_ptr<SpillFile> UnitReader::SpillBeside(std::span<const UnitId> units) const {
  const LockedCache cache(cache_);
  if (!user_->limits.spills) return nullptr;
  size_t bytes = 0;
  for (const UnitId u : units) {
    const size_t decoded = cache.units()[u].decoded_bytes;
    bytes += decoded > 0 ? decoded : cache.units().EstimateBytes(u);
  }
  return bytes > cache.UnitBudget() ? cache.spill().file() : nullptr;
}

void UnitReader::Prefetch(std::span<const UnitId> units) {
  if (prefetch_units_ == 0) return;
  LockedCache cache(cache_);
  const auto missing = [&](UnitId u) { return cache.units().empty(u); };
  if (std::ranges::none_of(units, missing)) return;
  cache.loaders().Start();
  // Without memory the query will load them itself.
  static_cast<void>(TryAllocate([&] {
    if (!cache_.at_once()) {
      AskAhead(units, user_, cache_.index(), cache_.options().budget_bytes, cache);
      return;
    }
    for (const UnitId u : units) {
      user_->done[u] = false;
      if (missing(u)) cache.loaders().Push(u, user_);
    }
  }));
  cache.loaders().Wake();
}

bool UnitReader::ShouldRelease() const {
  if (available_ != nullptr) return false;
  return held_.alone || cache_.awaited() ||
         held_.bytes > cache_.options().budget_bytes / kHeldShare;
}

bool UnitReader::MayRead(UnitId unit) const {
  const LockedCache cache(cache_);
  const ClusterIndex& index = cache_.index();
  uint64_t bytes = 0;
  std::vector<UnitId> open{unit};
  std::unordered_set<UnitId> visited;
  while (!open.empty()) {
    const UnitId u = open.back();
    open.pop_back();
    if (!visited.insert(u).second || cache.units().ready(u) || cache.spill().Has(u)) continue;
    if (index.unit(u).nodes > 0 && !user_->payloads.contains(u) &&
        cache.payloads().Find(u) == nullptr) {
      bytes += index.location(u).length;
    }
    for (const UnitId p : index.parents(u)) open.push_back(p);
  }
  return bytes <= user_->bytes_left();
}

LoadStats UnitReader::stats() const {
  const LockedCache cache(cache_);
  return user_->stats;
}

void UnitReader::FillStats(ExtractStats* stats) const {
  const LoadStats load = this->stats();
  stats->clusters_read = load.clusters_read;
  stats->clusters_cached = load.clusters_cached;
  stats->bytes_read = load.bytes_read;
  stats->seconds.load = load.seconds;
  stats->seconds.read = load.read_seconds;
  stats->seconds.decode = load.decode_seconds;
}

}  // namespace mtdb::internal
