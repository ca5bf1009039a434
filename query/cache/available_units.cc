// SPDX-License-Identifier: Apache-2.0
#include "query/cache/available_units.h"

#include <algorithm>
#include <functional>
#include <utility>

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

void MissingUnits::Note(UnitId unit, Reason reason) {
  if (noted_[unit]) return;
  MakeRoomForOne(list_);
  if (reason != Reason::kNotRead) reasons_.emplace(unit, reason);
  noted_[unit] = true;
  list_.push_back(unit);
}

void MissingUnits::Clear() {
  for (const UnitId u : list_) noted_[u] = false;
  list_.clear();
  reasons_.clear();
}

MissingUnits::Reason MissingUnits::reason(UnitId unit) const {
  const auto at = reasons_.find(unit);
  return at == reasons_.end() ? Reason::kNotRead : at->second;
}

AvailableUnits::AvailableUnits(ClusterCache& cache, CacheUserPtr user)
    : cache_(cache),
      user_(std::move(user)),
      most_bytes_(cache.options().budget_bytes - cache.options().budget_bytes / kOtherShare),
      taken_(cache.index().unit_count()),
      missing_(cache.index().unit_count()) {}

AvailableUnits::~AvailableUnits() {
  LockedCache cache(cache_);
  for (const UnitId u : list_) cache.Unpin(u);
}

void AvailableUnits::Begin(QueryControl* control, std::optional<TimePoint> until) {
  until_ = until;
  begun_ = std::chrono::steady_clock::now();
  decoded_ = out_of_time_ = false;
  missing_.Clear();
  LockedCache cache(cache_);
  user_->limits.control = control;
  came_bytes_ += user_->stats.bytes_read;
  user_->stats = {};
  cache.loaders().Start();
}

void AvailableUnits::End() {
  const LockedCache cache(cache_);
  user_->limits.control = nullptr;
}

void AvailableUnits::BeginRefining() {
  if (!until_) return;
  const TimePoint now = std::chrono::steady_clock::now();
  *until_ += now - begun_;
  begun_ = now;
}

Status AvailableUnits::failure(UnitId unit) const {
  const LockedCache cache(cache_);
  const auto at = user_->failures.find(unit);
  return at == user_->failures.end() ? Status::Ok() : at->second;
}

void AvailableUnits::ForgetFailures() {
  const LockedCache cache(cache_);
  user_->failures.clear();
}

Result<const LoadedUnit*> AvailableUnits::Take(UnitId unit) {
  if (taken_[unit] != nullptr) return taken_[unit];
  if (!missing_.Has(unit)) {
    const ClusterIndex& index = cache_.index();
    // All that is missing of what it comes from, so that it is asked for at one time.
    todo_.assign(1, unit);
    for (size_t i = 0; i < todo_.size(); ++i) {
      if (!index.Has(todo_[i])) continue;
      for (const UnitId p : index.parents(todo_[i])) {
        if (taken_[p] == nullptr && std::ranges::find(todo_, p) == todo_.end()) todo_.push_back(p);
      }
    }
    std::ranges::sort(todo_, std::greater<>());  // parents come first
    LockedCache cache(cache_);
    for (const UnitId u : todo_) {
      if (!missing_.Has(u)) TakeOne(u, cache);
    }
  }
  if (taken_[unit] != nullptr) return taken_[unit];
  return NotYet(UnitName(cache_.record(), unit) + ": is not in memory");
}

Status AvailableUnits::TakeRoot() {
  Status status;
  const ClusterIndex& index = cache_.index();
  for (UnitId id = index.cluster_count(); id < index.unit_count(); ++id) {
    const Result<const LoadedUnit*> unit = Take(id);
    if (unit.ok()) continue;
    Status failed = failure(id);
    if (missing_.reason(id) == MissingUnits::Reason::kNoRoom) {
      const LockedCache cache(cache_);
      failed = cache.NoRoom(id, cache.units().EstimateBytes(id));
    }
    if (status.ok() || !failed.ok()) status = failed.ok() ? unit.status() : failed;
  }
  return status;
}

void AvailableUnits::TakeOne(UnitId unit, LockedCache& cache) {
  MakeRoomForOne(list_);
  if (const std::optional<MissingUnits::Reason> reason = Pin(unit, cache)) {
    return missing_.Note(unit, *reason);
  }
  taken_[unit] = cache.units()[unit].value.get();
  list_.push_back(unit);
  bytes_ += cache.units()[unit].bytes;
}

std::optional<MissingUnits::Reason> AvailableUnits::Pin(UnitId unit, LockedCache& cache) {
  using Reason = MissingUnits::Reason;
  const ClusterIndex& index = cache_.index();
  if (user_->failures.contains(unit)) return Reason::kFailed;
  const bool parents = index.Has(unit) && std::ranges::all_of(index.parents(unit), [&](UnitId p) {
                         return taken_[p] != nullptr;
                       });
  if (!parents || cache.admission().closed()) return Reason::kNotRead;
  const bool ready = cache.units().ready(unit);
  if (const auto at = user_->no_room.find(unit); at != user_->no_room.end()) {
    if (!ready && cache.used_bytes() >= at->second) return Reason::kNoRoom;
    user_->no_room.erase(at);
  }
  const size_t bytes = ready ? cache.units()[unit].bytes : cache.units().EstimateBytes(unit);
  if (bytes_ + bytes > most_bytes_) return Reason::kNoRoom;
  if (ready) {
    if (index.unit(unit).nodes > 0 && !user_->read[unit]) ++user_->stats.clusters_cached;
    cache.Pin(unit);
    return std::nullopt;
  }
  const Status status = Load(unit, cache);
  if (status.ok()) return std::nullopt;
  if (status.code() == StatusCode::kNotYet) return Reason::kNotRead;
  if (status.code() == StatusCode::kBudgetExceeded || status.code() == StatusCode::kNoSpace) {
    user_->no_room[unit] = cache.used_bytes();
    return Reason::kNoRoom;
  }
  user_->failures[unit] = status;
  return Reason::kFailed;
}

// kNotYet: somebody else is at it, or will be.
Status AvailableUnits::Load(UnitId unit, LockedCache& cache) {
  // What a thread decodes goes again with it, unless it stays decoded between queries.
  const bool others_decode =
      cache.loaders().has_threads() && cache_.options().form == RuntimeForm::kExplicit;
  if (!cache.CanLoad(unit) || others_decode || !cache.units().empty(unit)) return NotYet("");
  if (decoded_ && time_is_over()) {
    out_of_time_ = true;
    return NotYet("");
  }
  decoded_ = true;
  cache.admission().Enter();
  const LoadOutcome loaded = cache.Load(unit, user_, Waiting::kNever);
  cache.admission().Leave();
  return loaded.status;
}

void AvailableUnits::KeepOnly(std::span<const UnitId> units) {
  std::vector<bool> keep(taken_.size());
  for (const auto list : {units, std::span<const UnitId>(held_)}) {
    for (const UnitId u : list) keep[u] = true;
  }
  std::ranges::sort(list_);  // parents are larger
  for (const UnitId u : list_) {
    if (!keep[u]) continue;
    for (const UnitId p : cache_.index().parents(u)) keep[p] = true;
  }
  LockedCache cache(cache_);
  std::erase_if(list_, [&](UnitId u) {
    if (keep[u]) return false;
    cache.Unpin(u);
    taken_[u] = nullptr;
    bytes_ -= cache.units()[u].bytes;
    return true;
  });
}

// In place of the jobs that this query has there.
void AvailableUnits::PushJobs(std::span<const UnitId> order, const std::vector<bool>& wanted,
                              LockedCache& cache) {
  cache.loaders().RemoveJobsOf(user_);
  if (!cache.loaders().has_threads()) return;
  size_t left = kJobsPerThread * cache_.options().threads;
  for (const UnitId u : order) {
    if (!wanted[u] || !cache.units().empty(u) || !cache.CanLoad(u)) continue;
    if (left-- == 0) break;
    cache.loaders().Push(u, user_);
  }
  cache.loaders().Wake();
}

void AvailableUnits::Ask(std::span<const UnitId> order, bool all) {
  LockedCache cache(cache_);
  const ClusterIndex& index = cache_.index();
  std::vector<bool> wanted(taken_.size());
  std::vector<UnitId> now;
  size_t on_the_way = 0, kept = bytes_;
  const size_t asked_bytes =
      std::min(std::clamp(static_cast<size_t>(came_bytes_ + user_->stats.bytes_read),
                          kFirstAskedBytes, kAskedBytes),
               cache_.options().budget_bytes / kOtherShare);
  for (const UnitId u : order) {
    if (user_->failures.contains(u) || user_->no_room.contains(u) || cache.units().ready(u)) {
      continue;
    }
    const size_t more =
        index.Has(u) ? cache.units().EstimateBytes(u) : cache.units().TypicalBytes();
    if (kept + more > most_bytes_) continue;
    kept += more;
    if (!cache.CanLoad(u)) {
      const bool first = on_the_way == 0;
      on_the_way += index.Has(u) ? index.location(u).length : 0;
      if (!first && on_the_way > asked_bytes) break;
      if (!cache.payloads().on_its_way(u)) now.push_back(u);
    }
    wanted[u] = true;
  }
  PushJobs(order, wanted, cache);
  // Of this query, and of others that are over and took what was there: a later one is their heir.
  cache.WithdrawIf([&](const PayloadDesk::Batch& batch) {
    const CacheUser& user = *batch.user;
    return all && (&user == user_.get() || (user.over && user.limits.available_only)) &&
           std::ranges::none_of(batch.units, [&](UnitId u) {
             return wanted[u] && cache.payloads().Expects(batch, u);
           });
  });
  if (!now.empty()) cache.Ask(now, user_, Asking::kToDecode);
}

}  // namespace mtdb::internal
