// SPDX-License-Identifier: Apache-2.0
// What ClusterCache asks its source for, what leaves it, and what a load has yet to do.
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "query/cache/cluster_cache.h"
#include "query/fields/make_room.h"

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

// What has left the cache. Units that have not been put into the file when it goes are decoded
// again. With the cache's mutex held at both ends.
struct ClusterCache::Dropped {
  struct Spill {
    UnitId id;
    LoadedUnitPtr unit;
    std::optional<SpillPlace> place;
  };
  explicit Dropped(ClusterCache& from) : cache(from) {}
  ~Dropped() {
    for (const Spill& spill : spills) cache.entries_[spill.id].spilled = false;
    Settle();
  }
  Dropped(const Dropped&) = delete;
  Dropped& operator=(const Dropped&) = delete;
  void Settle() {
    if (spills.empty()) return;
    for (const Spill& spill : spills) cache.entries_[spill.id].state = State::kEmpty;
    spills.clear();
    cache.loaded_.notify_all();
  }

  ClusterCache& cache;
  std::vector<LoadedUnitPtr> units;
  std::vector<Spill> spills;  // kLoading, and spilled
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
      if (cache_.entries_[u].spilled) from_file_.insert(u);
      for (const UnitId p : Parents(u)) open.push_back(p);
    }
    for (const UnitId u : todo_) {
      rows_ += cache_.index_.Has(u) ? 1 : 0;
      for (const UnitId p : Parents(u)) ++users_[p];
    }
    std::sort(todo_.begin(), todo_.end(), std::greater<>());
  }
  // True when a unit's parents have become known, or it is not in the file any more.
  bool outdated() const {
    if (std::ranges::any_of(from_file_, [&](UnitId u) {
          return cache_.entries_[u].state == State::kEmpty && !cache_.entries_[u].spilled;
        })) {
      return true;
    }
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
  // That it will be decoded from.
  std::span<const UnitId> Parents(UnitId unit) const {
    const bool decodes = cache_.index_.Has(unit) && !from_file_.contains(unit);
    return decodes ? cache_.index_.parents(unit) : std::span<const UnitId>();
  }
  void Clear() {
    for (const auto& [u, value] : pinned_) cache_.Unpin(u);
    for (const UnitId u : todo_) --cache_.entries_[u].plans;
    pinned_.clear();
    todo_.clear();
    users_.clear();
    from_file_.clear();
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
  std::unordered_set<UnitId> from_file_;  // of todo_
};

}  // namespace mtdb::internal
