// SPDX-License-Identifier: Apache-2.0
#include "query/cache/available_units.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "query/cache/cache_plan.h"
#include "query/fields/make_room.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {
namespace {

// What is kept leaves this share of the cache for what is on its way and what is being decoded.
constexpr size_t kOtherShare = 8;
// Payloads on their way: enough for 100 Mbit/s and 80 ms, and little to have asked for in vain. At
// first as much as came so far, so that on a slow line what is wanted most comes before the rest.
constexpr size_t kAskedBytes = size_t{1} << 20;
constexpr size_t kFirstAskedBytes = size_t{64} << 10;
constexpr size_t kJobsPerThread = 8;  // of a source that answers at once

}  // namespace

AvailableUnits::AvailableUnits(ClusterCache& cache, ClusterCache::ClientPtr client)
    : cache_(cache),
      client_(std::move(client)),
      most_bytes_(cache.budget_bytes() - cache.budget_bytes() / kOtherShare),
      taken_(cache.entries_.size()),
      noted_(cache.entries_.size()) {
  const MutexLock lock(cache_.mutex_);
  client_->takes_what_is_there = true;
}

AvailableUnits::~AvailableUnits() {
  const MutexLock lock(cache_.mutex_);
  for (const UnitId u : list_) cache_.Unpin(u);
}

void AvailableUnits::Begin(std::optional<TimePoint> until) {
  until_ = until;
  begun_ = std::chrono::steady_clock::now();
  decoded_ = out_of_time_ = false;
  for (const UnitId u : missing_) noted_[u] = false;
  missing_.clear();
  reasons_.clear();
  const MutexLock lock(cache_.mutex_);
  cache_.StartWorkers();
}

void AvailableUnits::BeginRefining() {
  if (!until_) return;
  const TimePoint now = std::chrono::steady_clock::now();
  *until_ += now - begun_;
  begun_ = now;
}

bool AvailableUnits::HasWorkers() const {
#if MTDB_THREADS
  return !cache_.workers_.empty();
#else
  return false;
#endif
}

void AvailableUnits::Note(UnitId unit, MissingCluster::Reason reason) {
  if (noted_[unit]) return;
  MakeRoomForOne(missing_);
  if (reason != MissingCluster::Reason::kNotRead) reasons_.emplace(unit, reason);
  noted_[unit] = true;
  missing_.push_back(unit);
}

MissingCluster::Reason AvailableUnits::reason(UnitId unit) const {
  const auto at = reasons_.find(unit);
  return at == reasons_.end() ? MissingCluster::Reason::kNotRead : at->second;
}

Status AvailableUnits::failure(UnitId unit) const {
  const MutexLock lock(cache_.mutex_);
  const auto at = client_->failures.find(unit);
  return at == client_->failures.end() ? Status::Ok() : at->second;
}

void AvailableUnits::ForgetFailures() {
  const MutexLock lock(cache_.mutex_);
  client_->failures.clear();
}

Result<const LoadedUnit*> AvailableUnits::Take(UnitId unit) {
  if (taken_[unit] != nullptr) return taken_[unit];
  if (!noted_[unit]) {
    const ClusterIndex& index = cache_.index_;
    // All that is missing of what it comes from, so that it is asked for at one time.
    todo_.assign(1, unit);
    for (size_t i = 0; i < todo_.size(); ++i) {
      if (!index.Has(todo_[i])) continue;
      for (const UnitId p : index.parents(todo_[i])) {
        if (taken_[p] == nullptr && std::ranges::find(todo_, p) == todo_.end()) todo_.push_back(p);
      }
    }
    std::ranges::sort(todo_, std::greater<>());
    ClusterCache::Lock lock(cache_.mutex_);
    for (const UnitId u : todo_) TakeOne(u, lock);
  }
  if (taken_[unit] != nullptr) return taken_[unit];
  return NotYet(UnitName(cache_.source_->record(), unit) + ": is not in memory");
}

Status AvailableUnits::TakeRoot() {
  Status status;
  for (UnitId id = cache_.index_.cluster_count(); id < cache_.index_.unit_count(); ++id) {
    const Result<const LoadedUnit*> unit = Take(id);
    if (unit.ok()) continue;
    Status failed = failure(id);
    if (reason(id) == MissingCluster::Reason::kNoRoom) {
      const MutexLock lock(cache_.mutex_);
      failed = cache_.NoRoom(id, cache_.EstimateBytes(id));
    }
    if (status.ok() || !failed.ok()) status = failed.ok() ? unit.status() : failed;
  }
  return status;
}

// Its parents come before it.
void AvailableUnits::TakeOne(UnitId unit, ClusterCache::Lock& lock) {
  using Reason = MissingCluster::Reason;
  if (noted_[unit]) return;
  const ClusterIndex& index = cache_.index_;
  ClusterCache::Entry& entry = cache_.entries_[unit];
  if (client_->failures.contains(unit)) return Note(unit, Reason::kFailed);
  const bool parents = index.Has(unit) && std::ranges::all_of(index.parents(unit), [&](UnitId p) {
                         return taken_[p] != nullptr;
                       });
  if (!parents || cache_.exclusive_ || cache_.exclusive_waiting_ > 0) {
    return Note(unit, Reason::kNotRead);
  }
  const bool ready = entry.state == ClusterCache::State::kReady;
  if (const auto at = client_->no_room.find(unit); at != client_->no_room.end()) {
    if (!ready && cache_.bytes_ >= at->second) return Note(unit, Reason::kNoRoom);
    client_->no_room.erase(at);
  }
  if (bytes_ + (ready ? entry.bytes : cache_.EstimateBytes(unit)) > most_bytes_) {
    return Note(unit, Reason::kNoRoom);
  }
  MakeRoomForOne(list_);
  if (ready) {
    if (index.unit(unit).nodes > 0 && !client_->read[unit]) ++client_->stats.clusters_cached;
    cache_.Pin(unit);
  } else {
    const Status status = Load(unit, lock);
    if (status.code() == StatusCode::kNotYet) return Note(unit, Reason::kNotRead);
    if (status.code() == StatusCode::kBudgetExceeded || status.code() == StatusCode::kNoSpace) {
      client_->no_room[unit] = cache_.bytes_;
      return Note(unit, Reason::kNoRoom);
    }
    if (!status.ok()) {
      client_->failures[unit] = status;
      return Note(unit, Reason::kFailed);
    }
  }
  taken_[unit] = entry.value.get();
  list_.push_back(unit);
  bytes_ += entry.bytes;
}

// kNotYet: somebody else is at it, or will be.
Status AvailableUnits::Load(UnitId unit, ClusterCache::Lock& lock) {
  const ClusterCache::Entry& entry = cache_.entries_[unit];
  // What a thread decodes goes again with it, unless it stays decoded between queries.
  const bool others_decode = HasWorkers() && cache_.options_.form == RuntimeForm::kExplicit;
  if (!cache_.CanLoad(unit) || others_decode || entry.state != ClusterCache::State::kEmpty) {
    return NotYet("");
  }
  if (decoded_ && time_is_over()) {
    out_of_time_ = true;
    return NotYet("");
  }
  decoded_ = true;
  cache_.Enter();
  ClusterCache::LoadRequest request{client_};
  request.waits = false;
  const Status status = cache_.Load(unit, request, lock).status();
  cache_.Leave();
  return status;
}

void AvailableUnits::KeepOnly(std::span<const UnitId> units) {
  std::vector<bool> keep(taken_.size());
  for (const auto list : {units, std::span<const UnitId>(held_)}) {
    for (const UnitId u : list) keep[u] = true;
  }
  std::ranges::sort(list_);  // parents are larger
  for (const UnitId u : list_) {
    if (!keep[u]) continue;
    for (const UnitId p : cache_.index_.parents(u)) keep[p] = true;
  }
  const MutexLock lock(cache_.mutex_);
  std::erase_if(list_, [&](UnitId u) {
    if (keep[u]) return false;
    cache_.Unpin(u);
    taken_[u] = nullptr;
    bytes_ -= cache_.entries_[u].bytes;
    return true;
  });
}

// Of this query, and of others that are over and took what was there: a later one is their heir.
void AvailableUnits::WithdrawUnwanted(const std::vector<bool>& wanted) {
  for (size_t i = cache_.batches_.size(); i-- > 0;) {
    const std::shared_ptr<ClusterCache::Batch> batch = cache_.batches_[i];
    const ClusterCache::Client& client = *batch->client;
    if (&client != client_.get() && !(client.stopped && client.takes_what_is_there)) continue;
    const bool any = std::ranges::any_of(batch->units, [&](UnitId u) {
      return wanted[u] && cache_.entries_[u].asked == batch.get();
    });
    if (!any) cache_.Withdraw(*batch);
  }
}

// In place of the jobs that this query has there.
void AvailableUnits::PushJobs(std::span<const UnitId> order) {
  std::vector<ClusterCache::Job> others;
  for (; !cache_.jobs_.empty(); cache_.jobs_.pop()) {
    if (cache_.jobs_.top().client != client_) others.push_back(cache_.jobs_.top());
  }
  for (ClusterCache::Job& job : others) cache_.jobs_.push(std::move(job));
  if (!HasWorkers()) return;
  size_t left = kJobsPerThread * cache_.threads();
  for (const UnitId u : order) {
    const ClusterCache::Entry& entry = cache_.entries_[u];
    if (entry.state != ClusterCache::State::kEmpty) continue;
    if (!cache_.CanLoad(u)) continue;
    if (left-- == 0) break;
    cache_.jobs_.push({u, client_});
  }
  cache_.work_.notify_all();
}

void AvailableUnits::Ask(std::span<const UnitId> order, bool all) {
  ClusterCache::Lock lock(cache_.mutex_);
  const ClusterIndex& index = cache_.index_;
  std::vector<bool> wanted(taken_.size());
  std::vector<UnitId> now;
  size_t on_the_way = 0, kept = bytes_;
  const size_t asked_bytes =
      std::min(std::clamp(static_cast<size_t>(came_bytes_ + client_->stats.bytes_read),
                          kFirstAskedBytes, kAskedBytes),
               cache_.budget_bytes() / kOtherShare);
  for (const UnitId u : order) {
    const ClusterCache::Entry& entry = cache_.entries_[u];
    if (client_->failures.contains(u) || client_->no_room.contains(u)) continue;
    if (entry.state == ClusterCache::State::kReady) continue;
    const size_t more = index.Has(u) ? cache_.EstimateBytes(u) : cache_.TypicalBytes();
    if (kept + more > most_bytes_) continue;
    kept += more;
    const size_t bytes = index.Has(u) ? index.location(u).length : 0;
    if (!cache_.CanLoad(u)) {
      const bool first = on_the_way == 0;
      on_the_way += bytes;
      if (!first && on_the_way > asked_bytes) break;
      if (entry.asked == nullptr) now.push_back(u);
    }
    wanted[u] = true;
  }
  if (all) WithdrawUnwanted(wanted);
  std::vector<UnitId> decode;
  for (const UnitId u : order) {
    if (wanted[u]) decode.push_back(u);
  }
  PushJobs(decode);
  cache_.TellSource(lock);
  if (!now.empty()) cache_.Ask(now, client_, ClusterCache::Asking::kToDecode, lock);
}

}  // namespace mtdb::internal
