// SPDX-License-Identifier: Apache-2.0
#include "query/cache/unit_reader.h"

#include <algorithm>
#include <string>
#include <unordered_set>
#include <utility>

#include "query/cache/available_units.h"
#include "query/fields/make_room.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {

namespace {

using Clock = std::chrono::steady_clock;
// How long a cancelled query may sleep on.
constexpr std::chrono::milliseconds kWatch{4};
// What a query holds between steps takes at most this share of the cache.
constexpr size_t kHeldShare = 16;
// What is loaded ahead of a query takes at most this share of the cache.
constexpr size_t kPrefetchShare = 4;
constexpr size_t kPrefetchPerThread = 8;
constexpr size_t kAskedAhead = 64;  // of a source that answers later

}  // namespace

UnitReader::UnitReader(ClusterCache& cache, const ReaderLimits& limits)
    : cache_(cache),
      limits_(limits),
      client_(std::make_shared<ClusterCache::Client>()),
      seen_(cache.entries_.size()) {
  client_->read.resize(cache.entries_.size());
  client_->done.resize(cache.entries_.size());
  client_->control = limits.control;
  cache.AddReader(limits.spills);
  if (limits.available_only) {
    available_ = std::make_unique<AvailableUnits>(cache, client_);
    return;
  }
  if ((cache.threads() < 2 && cache.at_once_) || limits.max_bytes) return;
  const size_t most = cache.at_once_ ? kPrefetchPerThread * cache.threads() : kAskedAhead;
  prefetch_units_ = std::min(most, cache.budget_bytes() / kPrefetchShare / cache.TypicalBytes());
}

UnitReader::~UnitReader() {
  Release();
  available_.reset();
  cache_.RemoveReader(*client_, limits_.spills);
}

Status UnitReader::Check() {
  if (limits_.control != nullptr && limits_.control->cancelled()) {
    return {StatusCode::kCancelled, cache_.source_->record().name + ": the query was cancelled"};
  }
  if (deadline_ && Clock::now() >= *deadline_) {
    out_of_time_ = true;
    return {StatusCode::kBudgetExceeded, cache_.source_->record().name + ": the time is over"};
  }
  return Status::Ok();
}

bool UnitReader::IsAvailable(UnitId unit) {
  return available_ == nullptr || available_->Take(unit).ok();
}

void UnitReader::BeginCall(QueryControl* control,
                           std::optional<std::chrono::steady_clock::time_point> until) {
  {
    const MutexLock lock(cache_.mutex_);
    limits_.control = client_->control = control;
    available_->CountBytes(client_->stats.bytes_read);
    client_->stats = {};
  }
  available_->Begin(until);
}

Status UnitReader::WaitOn(ConditionVariable& changed, ClusterCache::Lock& lock) const {
  if (!cache_.options_.waits) {
    return NotYet(cache_.source_->record().name + ": other queries hold the cache; ask again");
  }
#if MTDB_THREADS
  if (limits_.control == nullptr && !deadline_) {
    changed.wait(lock);
  } else {
    changed.wait_for(lock, kWatch);
  }
#else
  static_cast<void>(changed);
  static_cast<void>(lock);
#endif
  return Status::Ok();
}

void UnitReader::NoteLoad() {
  if (limits_.control != nullptr) limits_.control->CountLoad();
}

void UnitReader::CutToLimit(std::vector<UnitId>& units) const {
  if (!limits_.max_bytes) return;
  uint64_t left = BytesLeft();
  const ClusterIndex& index = cache_.index_;
  for (size_t i = 0; i < units.size(); ++i) {
    if (!index.Has(units[i]) || index.unit(units[i]).nodes == 0) continue;
    const uint64_t bytes = index.location(units[i]).length;
    if (bytes > left) {
      units.resize(i);
      return;
    }
    left -= bytes;
  }
}

Status UnitReader::OverLimit(UnitId unit) {
  out_of_bytes_ = true;
  return {StatusCode::kBudgetExceeded,
          UnitName(cache_.source_->record(), unit) + ": to read it exceeds the query's limit of " +
              std::to_string(*limits_.max_bytes) + " bytes; raise it, or the cache's size"};
}

// Whoever waits for exclusive use goes first.
Status UnitReader::Enter(ClusterCache::Lock& lock) {
  while (cache_.exclusive_ || cache_.exclusive_waiting_ > 0) {
    MTDB_RETURN_IF_ERROR(Check());
    MTDB_RETURN_IF_ERROR(WaitOn(cache_.room_, lock));
  }
  cache_.Enter();
  return Status::Ok();
}

Status UnitReader::WaitForRoom() {
  MTDB_CHECK(held_.empty(), "who waits for room holds nothing");
  const auto start = Clock::now();
  ClusterCache::Lock lock(cache_.mutex_);
  ++cache_.exclusive_waiting_;
  Status status;
  while (status.ok() && (cache_.exclusive_ || cache_.holders_ > 0)) {
    status = CatchOutOfMemory([&]() -> Status {
      MTDB_RETURN_IF_ERROR(WaitOn(cache_.room_, lock));
      return Check();
    });
  }
  --cache_.exclusive_waiting_;
  if (status.ok()) {
    cache_.exclusive_ = exclusive_ = true;
    cache_.Enter();
  } else {
    cache_.room_.notify_all();
  }
  client_->stats.seconds += std::chrono::duration<double>(Clock::now() - start).count();
  return status;
}

Result<const LoadedUnit*> UnitReader::Get(UnitId unit) {
  crowded_ = false;
  if (available_ != nullptr) return available_->Take(unit);
  MakeRoomForOne(held_);
  for (;;) {
    {
      ClusterCache::Lock lock(cache_.mutex_);
      MTDB_CHECK(unit < cache_.entries_.size(), "no such cluster or root piece");
      const bool inside = exclusive_ || !held_.empty();
      const auto start = Clock::now();
      if (!inside) MTDB_RETURN_IF_ERROR(Enter(lock));
      ClusterCache::Entry& entry = cache_.entries_[unit];
      if (!seen_[unit]) {
        seen_[unit] = true;
        const bool there =
            (entry.state == ClusterCache::State::kReady || entry.payload != nullptr) &&
            !client_->read[unit];
        if (there && cache_.index_.unit(unit).nodes > 0) ++client_->stats.clusters_cached;
      }
      Status status;
      bool crowded = false;
      if (entry.state == ClusterCache::State::kReady) {
        cache_.Pin(unit);
      } else {
        ClusterCache::LoadRequest request{client_, this, exclusive_, true};
        status = cache_.Load(unit, request, lock).status();
        crowded = request.no_room;
        client_->stats.seconds += std::chrono::duration<double>(Clock::now() - start).count();
      }
      if (status.ok()) {
        status = Admit(unit);
        if (status.ok()) return entry.value.get();
        cache_.Unpin(unit);
        crowded = !held_.empty();
      }
      if (!inside) cache_.Leave();
      if (!crowded || inside) {
        crowded_ = crowded && (!exclusive_ || !held_.empty());
        return status;
      }
    }
    MTDB_RETURN_IF_ERROR(WaitForRoom());
  }
}

// A unit that is there by chance may be gone the next time. What may be held together must not
// depend on that: each of them finds room to be loaded anew beside the others.
Status UnitReader::Admit(UnitId unit) {
  const ClusterCache::Entry& entry = cache_.entries_[unit];
  const size_t overhead = std::max(held_overhead_, entry.overhead);
  const size_t needed = held_bytes_ + entry.bytes + overhead;
  if (needed > cache_.budget_bytes()) return cache_.TooSmall(unit, needed);
  held_.push_back(unit);
  held_bytes_ += entry.bytes;
  held_overhead_ = overhead;
  return Status::Ok();
}

void UnitReader::Release() {
  if (held_.empty() && !exclusive_) return;
  const MutexLock lock(cache_.mutex_);
  for (const UnitId u : held_) cache_.Unpin(u);
  held_.clear();
  held_bytes_ = held_overhead_ = 0;
  if (exclusive_) {
    cache_.exclusive_ = exclusive_ = false;
    cache_.room_.notify_all();
  }
  cache_.Leave();
}

bool UnitReader::Fit(std::span<const UnitId> units) const {
  const MutexLock lock(cache_.mutex_);
  size_t left = cache_.UnitBudget();
  for (const UnitId u : units) {
    const size_t decoded = cache_.entries_[u].decoded_bytes;
    const size_t bytes = decoded > 0 ? decoded : cache_.EstimateBytes(u);
    if (bytes > left) return false;
    left -= bytes;
  }
  return true;
}

std::shared_ptr<SpillFile> UnitReader::spill_file() const {
  const MutexLock lock(cache_.mutex_);
  return limits_.spills ? cache_.spill_ : nullptr;
}

bool UnitReader::IsReady(UnitId unit) {
  const MutexLock lock(cache_.mutex_);
  return cache_.entries_[unit].state == ClusterCache::State::kReady;
}

void UnitReader::Prefetch(std::span<const UnitId> units) {
  if (prefetch_units_ == 0) return;
  ClusterCache::Lock lock(cache_.mutex_);
  const auto missing = [&](UnitId u) {
    return cache_.entries_[u].state == ClusterCache::State::kEmpty;
  };
  if (std::ranges::none_of(units, missing)) return;
  cache_.StartWorkers();
  // Without memory the query will load them itself.
  static_cast<void>(TryAllocate([&] {
    if (!cache_.at_once_) {
      cache_.AskAhead(units, client_, lock);
      return;
    }
    for (const UnitId u : units) {
      client_->done[u] = false;
      if (missing(u)) cache_.jobs_.push({u, client_});
    }
  }));
  cache_.work_.notify_all();
}

bool UnitReader::ShouldRelease() const {
  if (available_ != nullptr) return false;
  return exclusive_ || cache_.exclusive_waiting_ > 0 ||
         held_bytes_ > cache_.budget_bytes() / kHeldShare;
}

uint64_t UnitReader::BytesToRead(UnitId unit) const {
  const MutexLock lock(cache_.mutex_);
  uint64_t bytes = 0;
  std::vector<UnitId> open{unit};
  std::unordered_set<UnitId> visited;
  while (!open.empty()) {
    const UnitId u = open.back();
    open.pop_back();
    if (!visited.insert(u).second) continue;
    const ClusterCache::Entry& entry = cache_.entries_[u];
    if (entry.state == ClusterCache::State::kReady || entry.spilled) continue;
    if (cache_.index_.unit(u).nodes > 0 && !payloads_.contains(u) &&
        cache_.entries_[u].payload == nullptr) {
      bytes += cache_.index_.location(u).length;
    }
    for (const UnitId p : cache_.index_.parents(u)) open.push_back(p);
  }
  return bytes;
}

uint64_t UnitReader::bytes_left() const {
  const MutexLock lock(cache_.mutex_);
  return BytesLeft();
}

uint64_t UnitReader::BytesLeft() const {
  const uint64_t read = client_->stats.bytes_read;
  return *limits_.max_bytes > read ? *limits_.max_bytes - read : 0;
}

LoadStats UnitReader::stats() const {
  const MutexLock lock(cache_.mutex_);
  return client_->stats;
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
