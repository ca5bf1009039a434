// SPDX-License-Identifier: Apache-2.0
// What ClusterCache asks its source for, and what a load has yet to do.
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "query/internal/cluster_cache.h"
#include "query/internal/make_room.h"

namespace mtdb::internal {

// What was asked for in one call. The fields are guarded by the cache's mutex.
class ClusterCache::Batch final : public PayloadReceiver {
 public:
  Batch(std::shared_ptr<Door> door, ClientPtr for_client, Asking why)
      : client(std::move(for_client)), asking(why), door_(std::move(door)) {}
  void Receive(UnitId unit, Result<Bytes> payload) override {
    const MutexLock lock(door_->mutex);
    if (door_->cache != nullptr) door_->cache->Arrive(*this, unit, std::move(payload));
  }

  const ClientPtr client;
  std::vector<UnitId> units;
  size_t open = 0;  // that are on their way
  const Asking asking;

 private:
  const std::shared_ptr<Door> door_;
};

// What a load has yet to do: the units that are not ready, and pins on those that they come from.
class ClusterCache::Plan {
 public:
  Plan(ClusterCache& cache, UnitId target) : cache_(cache), target_(target) {}
  ~Plan() { Clear(); }
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;

  void Make() {
    Clear();
    std::vector<UnitId> open{target_};
    while (!open.empty()) {
      const UnitId u = open.back();
      open.pop_back();
      if (users_.contains(u)) continue;
      users_.emplace(u, 0);
      if (cache_.entries_[u].state == State::kReady) {
        PinUnit(u);
        continue;
      }
      MakeRoomForOne(todo_);
      todo_.push_back(u);
      ++cache_.entries_[u].plans;
      for (const UnitId p : Parents(u)) open.push_back(p);
    }
    for (const UnitId u : todo_) {
      rows_ += cache_.index_.Has(u) ? 1 : 0;
      for (const UnitId p : Parents(u)) ++users_[p];
    }
    std::sort(todo_.begin(), todo_.end(), std::greater<>());
  }
  // True when a unit's parents have become known.
  bool outdated() const {
    return rows_ < std::ranges::count_if(
                       todo_, [&](UnitId u) { return cache_.index_.Has(u); });
  }

  const std::vector<UnitId>& todo() const { return todo_; }
  bool HasParents(UnitId unit) const {
    return cache_.index_.Has(unit) &&
           std::ranges::all_of(Parents(unit), [&](UnitId p) { return pinned_.contains(p); });
  }
  // The unit is ready: its parents are needed for one thing less.
  void Finish(UnitId unit) {
    PinUnit(unit);
    std::vector<UnitId> done{unit};
    while (!done.empty()) {
      const UnitId u = done.back();
      done.pop_back();
      if (std::erase(todo_, u) > 0) {
        --cache_.entries_[u].plans;
        --rows_;
      }
      for (const UnitId p : Parents(u)) {
        if (--users_[p] > 0) continue;
        if (pinned_.erase(p) > 0) {
          cache_.Unpin(p);
        } else {
          done.push_back(p);
        }
      }
    }
  }
  // Room for `unit` is worth more than the payloads of what comes after it.
  bool GiveUpPayloads(UnitId unit) {
    bool any = false;
    for (const UnitId u : todo_) {
      Entry& entry = cache_.entries_[u];
      if (u == unit || entry.plans > 1) continue;
      if (entry.asked == nullptr && entry.payload == nullptr) continue;
      if (entry.asked != nullptr) cache_.Withdraw(u);
      if (entry.payload != nullptr) cache_.DropPayload(u);
      any = true;
    }
    return any;
  }
  // Hands the target's pin to the caller.
  LoadedUnitPtr Take() {
    LoadedUnitPtr value = pinned_.at(target_);
    pinned_.erase(target_);
    return value;
  }

 private:
  std::span<const UnitId> Parents(UnitId unit) const {
    return cache_.index_.Has(unit) ? cache_.index_.parents(unit) : std::span<const UnitId>();
  }
  void Clear() {
    for (const auto& [u, value] : pinned_) cache_.Unpin(u);
    for (const UnitId u : todo_) --cache_.entries_[u].plans;
    pinned_.clear();
    todo_.clear();
    users_.clear();
    rows_ = 0;
  }
  void PinUnit(UnitId unit) {
    pinned_.emplace(unit, cache_.entries_[unit].value);
    cache_.Pin(unit);
  }

  ClusterCache& cache_;
  const UnitId target_;
  std::vector<UnitId> todo_;                    // coarsest first
  std::ptrdiff_t rows_ = 0;                     // of these, in the index
  std::unordered_map<UnitId, uint32_t> users_;  // units of todo_ that a unit is a parent of
  std::unordered_map<UnitId, LoadedUnitPtr> pinned_;
};

}  // namespace mtdb::internal
