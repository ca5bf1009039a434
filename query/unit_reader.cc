#include "query/unit_reader.h"

#include <algorithm>
#include <unordered_set>
#include <utility>

#include "query/internal/make_room.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

namespace {

using Clock = std::chrono::steady_clock;
// How long a cancelled query may sleep on.
constexpr std::chrono::milliseconds kWatch{4};
// What a query holds between steps takes at most this share of the cache.
constexpr size_t kHeldShare = 16;
// What is loaded ahead of a query takes at most this share of the cache.
constexpr size_t kPrefetchShare = 4;
constexpr size_t kPrefetchPerThread = 8;

}  // namespace

UnitReader::UnitReader(ClusterCache& cache, const ReaderLimits& limits)
    : cache_(cache),
      limits_(limits),
      tally_(std::make_shared<ClusterCache::Tally>()),
      seen_(cache.entries_.size()) {
  tally_->read.resize(cache.entries_.size());
  {
    const std::lock_guard lock(cache.mutex_);
    ++cache.readers_;
  }
  if (cache.threads() < 2 || limits.max_bytes || cache.index_.cluster_count() == 0) return;
  const size_t typical = cache.EstimateBytes(0);  // of the finest round, as most are
  prefetch_units_ = std::min(kPrefetchPerThread * cache.threads(),
                             cache.budget_bytes() / kPrefetchShare / typical);
}

UnitReader::~UnitReader() {
  Release();
  cache_.RemoveReader(*tally_);
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

void UnitReader::WaitOn(std::condition_variable& changed, ClusterCache::Lock& lock) const {
  if (limits_.control == nullptr && !deadline_) {
    changed.wait(lock);
  } else {
    changed.wait_for(lock, kWatch);
  }
}

void UnitReader::NoteLoad() {
  if (limits_.control == nullptr) return;
  limits_.control->clusters_loaded_.fetch_add(1, std::memory_order_relaxed);
}

// Whoever waits for exclusive use goes first.
Status UnitReader::Enter(ClusterCache::Lock& lock) {
  while (cache_.exclusive_ || cache_.exclusive_waiting_ > 0) {
    MTDB_RETURN_IF_ERROR(Check());
    WaitOn(cache_.room_, lock);
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
    WaitOn(cache_.room_, lock);
    status = CatchOutOfMemory([&] { return Check(); });
  }
  --cache_.exclusive_waiting_;
  if (status.ok()) {
    cache_.exclusive_ = exclusive_ = true;
    cache_.Enter();
  } else {
    cache_.room_.notify_all();
  }
  tally_->stats.seconds += std::chrono::duration<double>(Clock::now() - start).count();
  return status;
}

Result<const LoadedUnit*> UnitReader::Get(UnitId unit) {
  crowded_ = false;
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
            !tally_->read[unit];
        if (there && cache_.index_.unit(unit).nodes > 0) ++tally_->stats.clusters_cached;
      }
      Status status;
      bool crowded = false;
      if (entry.state == ClusterCache::State::kReady) {
        cache_.Pin(unit);
      } else {
        ClusterCache::Errand errand{*tally_, this, exclusive_, true};
        status = cache_.Load(unit, errand, lock).status();
        crowded = errand.no_room && !exclusive_;
        tally_->stats.seconds += std::chrono::duration<double>(Clock::now() - start).count();
      }
      if (status.ok()) {
        held_.push_back(unit);
        held_bytes_ += entry.bytes;
        return entry.value.get();
      }
      if (!inside) cache_.Leave();
      if (!crowded || inside) {
        crowded_ = crowded;
        return status;
      }
    }
    MTDB_RETURN_IF_ERROR(WaitForRoom());
  }
}

void UnitReader::Release() {
  if (held_.empty() && !exclusive_) return;
  const std::lock_guard lock(cache_.mutex_);
  for (const UnitId u : held_) cache_.Unpin(u);
  held_.clear();
  held_bytes_ = 0;
  if (exclusive_) {
    cache_.exclusive_ = exclusive_ = false;
    cache_.room_.notify_all();
  }
  cache_.Leave();
}

void UnitReader::Prefetch(std::span<const UnitId> units) {
  if (prefetch_units_ == 0) return;
  const std::lock_guard lock(cache_.mutex_);
  const auto missing = [&](UnitId u) {
    return cache_.entries_[u].state == ClusterCache::State::kEmpty;
  };
  if (std::ranges::none_of(units, missing)) return;
  cache_.StartWorkers();
  if (cache_.workers_.empty()) return;
  try {
    for (const UnitId u : units) {
      if (missing(u)) cache_.jobs_.push({u, tally_});
    }
  } catch (const std::bad_alloc&) {  // the query will load them itself
  }
  cache_.work_.notify_all();
}

bool UnitReader::ShouldRelease() const {
  return exclusive_ || cache_.exclusive_waiting_ > 0 ||
         held_bytes_ > cache_.budget_bytes() / kHeldShare;
}

uint64_t UnitReader::BytesToRead(UnitId unit) const {
  const std::lock_guard lock(cache_.mutex_);
  uint64_t bytes = 0;
  std::vector<UnitId> open{unit};
  std::unordered_set<UnitId> visited;
  while (!open.empty()) {
    const UnitId u = open.back();
    open.pop_back();
    if (!visited.insert(u).second) continue;
    if (cache_.entries_[u].state == ClusterCache::State::kReady) continue;
    if (cache_.index_.unit(u).nodes > 0 && !payloads_.contains(u) &&
        cache_.entries_[u].payload == nullptr) {
      bytes += cache_.index_.location(u).length;
    }
    for (const UnitId p : cache_.index_.parents(u)) open.push_back(p);
  }
  return bytes;
}

uint64_t UnitReader::bytes_left() const {
  const uint64_t read = stats().bytes_read;
  return *limits_.max_bytes > read ? *limits_.max_bytes - read : 0;
}

LoadStats UnitReader::stats() const {
  const std::lock_guard lock(cache_.mutex_);
  return tally_->stats;
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

}  // namespace mtdb
