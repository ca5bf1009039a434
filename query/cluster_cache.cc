#include "query/cluster_cache.h"

#include <algorithm>
#include <chrono>
#include <functional>
#include <string>

namespace mtdb {

// No deadlock: a thread waits for a unit only when those that it has claimed and not yet published
// are all finer, since plans are executed coarsest first. In a circle of waiting threads each would
// wait for a unit coarser than the one before.

ClusterCache::ClusterCache(std::shared_ptr<ClusterSource> source, size_t budget_bytes)
    : source_(std::move(source)),
      budget_bytes_(budget_bytes),
      entries_(UnitCount(source_->index())) {}

Result<LoadedUnitPtr> ClusterCache::Get(UnitId unit, LoadStats* stats) {
  {
    const std::lock_guard lock(mutex_);
    MTDB_CHECK(unit < entries_.size(), "no such cluster or root piece");
    if (entries_[unit].state == State::kReady) {
      Touch(unit);
      return entries_[unit].value;
    }
  }
  const auto start = std::chrono::steady_clock::now();
  Result<LoadedUnitPtr> result = Load(unit, *stats);
  stats->seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

Result<LoadedUnitPtr> ClusterCache::Load(UnitId unit, LoadStats& stats) {
  Plan plan;
  MakePlan(unit, plan);
  if (const Status status = Execute(plan, stats); !status.ok()) {
    Abandon(plan.claimed);
    return status;
  }
  const LoadedUnitPtr value = plan.pinned.at(unit);
  plan.pinned.clear();
  Trim();
  return value;
}

// Claims the unit and every ancestor that is neither ready nor being loaded, as far up as needed.
void ClusterCache::MakePlan(UnitId unit, Plan& plan) {
  std::vector<UnitId> open{unit};
  const std::lock_guard lock(mutex_);
  while (!open.empty()) {
    const UnitId u = open.back();
    open.pop_back();
    Entry& entry = entries_[u];
    switch (entry.state) {
      case State::kReady:
        Touch(u);
        plan.pinned.emplace(u, entry.value);
        break;
      case State::kLoading:
        plan.awaited.push_back(u);  // perhaps our own claim: sorted out below
        break;
      case State::kEmpty:
        entry.state = State::kLoading;
        plan.claimed.push_back(u);
        for (const UnitId p : UnitParents(source_->index(), u)) open.push_back(p);
        break;
    }
  }
  std::sort(plan.claimed.begin(), plan.claimed.end(), std::greater<>());
  std::sort(plan.awaited.begin(), plan.awaited.end(), std::greater<>());
  plan.awaited.erase(std::unique(plan.awaited.begin(), plan.awaited.end()), plan.awaited.end());
  std::erase_if(plan.awaited, [&](UnitId u) {
    return std::binary_search(plan.claimed.begin(), plan.claimed.end(), u, std::greater<>());
  });
}

Status ClusterCache::ReadPayloads(Plan& plan, LoadStats& stats) {
  const uint32_t clusters = source_->index().cluster_count();
  std::vector<ClusterId> cluster_ids;
  std::vector<RootPieceId> root_ids;
  for (const UnitId u : plan.claimed) {
    if (u < clusters) {
      cluster_ids.emplace_back(u);
    } else {
      root_ids.emplace_back(u - clusters);
    }
  }
  const auto receive = [&](UnitId u, Bytes payload) {
    stats.bytes_read += payload.size();
    ++(u < clusters ? stats.clusters_read : stats.root_pieces_read);
    plan.payloads[u] = std::move(payload);
    return Status::Ok();
  };
  if (!root_ids.empty()) {
    MTDB_RETURN_IF_ERROR(source_->ReadRootPieces(root_ids, [&](RootPieceId id, Bytes payload) {
      return receive(clusters + id.value, std::move(payload));
    }));
  }
  if (!cluster_ids.empty()) {
    MTDB_RETURN_IF_ERROR(source_->ReadClusters(cluster_ids, [&](ClusterId id, Bytes payload) {
      return receive(id.value, std::move(payload));
    }));
  }
  for (const UnitId u : plan.claimed) {
    if (!plan.payloads.contains(u)) {
      return IoError(UnitName(source_->record(), u) + ": the source did not deliver the payload");
    }
  }
  return Status::Ok();
}

// Loads what was claimed and waits for the rest, coarsest first. On return `claimed` holds what
// has not been published.
Status ClusterCache::Execute(Plan& plan, LoadStats& stats) {
  if (!plan.claimed.empty()) MTDB_RETURN_IF_ERROR(ReadPayloads(plan, stats));
  size_t awaited = 0;
  while (!plan.claimed.empty() || awaited < plan.awaited.size()) {
    if (awaited < plan.awaited.size() &&
        (plan.claimed.empty() || plan.awaited[awaited] > plan.claimed.front())) {
      const UnitId u = plan.awaited[awaited++];
      MTDB_ASSIGN_OR_RETURN(plan.pinned[u], Await(u, stats));
      continue;
    }
    const UnitId u = plan.claimed.front();
    std::vector<LoadedUnitPtr> parents;
    for (const UnitId p : UnitParents(source_->index(), u)) parents.push_back(plan.pinned.at(p));
    MTDB_ASSIGN_OR_RETURN(const LoadedUnitPtr value, LoadUnit(source_->record(), source_->index(),
                                                              u, plan.payloads.at(u), parents));
    plan.payloads.erase(u);
    plan.pinned[u] = value;
    plan.claimed.erase(plan.claimed.begin());
    Publish(u, value);
  }
  return Status::Ok();
}

// Waits until another thread has loaded the unit; loads it here when that thread failed or the
// unit is gone again.
Result<LoadedUnitPtr> ClusterCache::Await(UnitId unit, LoadStats& stats) {
  {
    std::unique_lock lock(mutex_);
    loaded_.wait(lock, [&] { return entries_[unit].state != State::kLoading; });
    if (entries_[unit].state == State::kReady) {
      Touch(unit);
      return entries_[unit].value;
    }
  }
  return Load(unit, stats);
}

void ClusterCache::Publish(UnitId unit, const LoadedUnitPtr& value) {
  std::vector<LoadedUnitPtr> dropped;  // freed after the lock
  {
    const std::lock_guard lock(mutex_);
    Entry& entry = entries_[unit];
    entry.value = value;
    entry.bytes = value->memory_bytes();
    entry.state = State::kReady;
    bytes_ += entry.bytes;
    ++decoded_;
    Link(unit);
    TrimLocked(dropped);
  }
  loaded_.notify_all();
}

void ClusterCache::Abandon(std::span<const UnitId> units) {
  {
    const std::lock_guard lock(mutex_);
    for (const UnitId u : units) entries_[u].state = State::kEmpty;
  }
  loaded_.notify_all();
}

void ClusterCache::Trim() {
  std::vector<LoadedUnitPtr> dropped;
  const std::lock_guard lock(mutex_);
  TrimLocked(dropped);
}

size_t ClusterCache::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

uint64_t ClusterCache::decoded() const {
  const std::lock_guard lock(mutex_);
  return decoded_;
}

void ClusterCache::Link(UnitId unit) {
  Entry& entry = entries_[unit];
  entry.newer = kNone32;
  entry.older = newest_;
  (newest_ == kNone32 ? oldest_ : entries_[newest_].newer) = unit;
  newest_ = unit;
}

void ClusterCache::Unlink(UnitId unit) {
  const Entry& entry = entries_[unit];
  (entry.newer == kNone32 ? newest_ : entries_[entry.newer].older) = entry.older;
  (entry.older == kNone32 ? oldest_ : entries_[entry.older].newer) = entry.newer;
}

void ClusterCache::Touch(UnitId unit) {
  if (newest_ == unit) return;
  Unlink(unit);
  Link(unit);
}

// A use count of one is the cache's own pointer: nobody else can copy it without the mutex.
void ClusterCache::TrimLocked(std::vector<LoadedUnitPtr>& dropped) {
  uint32_t unit = oldest_;
  while (bytes_ > budget_bytes_ && unit != kNone32) {
    Entry& entry = entries_[unit];
    const uint32_t next = entry.newer;
    if (entry.value.use_count() == 1) {
      Unlink(unit);
      dropped.push_back(std::move(entry.value));
      bytes_ -= entry.bytes;
      entry = Entry{};
    }
    unit = next;
  }
}

}  // namespace mtdb
