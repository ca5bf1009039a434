// SPDX-License-Identifier: Apache-2.0
// LoadPlan: what has yet to be done until a unit is loaded.
#pragma once

#include <algorithm>
#include <functional>
#include <span>
#include <unordered_map>
#include <vector>

#include "query/cache/cache_memory.h"
#include "query/fields/make_room.h"

namespace mtdb::internal {

// The units that are not ready, whose payloads it wants, and pins on those that they come from.
// With the cache's mutex held.
class LoadPlan {
 public:
  LoadPlan(CacheMemory& memory, UnitId target) : memory_(memory), target_(target) {}
  ~LoadPlan() { Clear(); }
  LoadPlan(const LoadPlan&) = delete;
  LoadPlan& operator=(const LoadPlan&) = delete;

  // From what is there now. What has been pinned or wanted is in `needs_` or `todo_` before memory
  // is asked for again.
  void Make() {
    Clear();
    std::vector<UnitId> open{target_};
    while (!open.empty()) {
      const UnitId u = open.back();
      open.pop_back();
      if (!needs_.try_emplace(u).second) continue;
      if (memory_.units.ready(u)) {
        Pin(u);
        continue;
      }
      MakeRoomForOne(todo_);
      todo_.push_back(u);
      memory_.payloads.Want(u);
      needs_[u].from_file = memory_.spill.Has(u);
      for (const UnitId p : Parents(u)) open.push_back(p);
    }
    for (const UnitId u : todo_) {
      rows_ += memory_.index.Has(u) ? 1 : 0;
      for (const UnitId p : Parents(u)) ++needs_[p].users;
    }
    std::ranges::sort(todo_, std::greater<>());
  }
  // True when a unit's parents have become known, or it is not in the file any more.
  bool outdated() const {
    if (std::ranges::any_of(todo_, [&](UnitId u) {
          return needs_.at(u).from_file && memory_.units.empty(u) && !memory_.spill.Has(u);
        })) {
      return true;
    }
    return rows_ < std::ranges::count_if(
                       todo_, [&](UnitId u) { return memory_.index.Has(u); });
  }
  // The units to load, coarsest first; empty when the target is ready.
  const std::vector<UnitId>& todo() const { return todo_; }
  // It can be decoded, or comes from the file.
  bool HasParents(UnitId unit) const {
    return memory_.index.Has(unit) && std::ranges::all_of(Parents(unit), [&](UnitId p) {
             const auto at = needs_.find(p);
             return at != needs_.end() && at->second.pinned;
           });
  }
  // The unit is ready: its parents are needed for one thing less.
  void Finish(UnitId unit) {
    Pin(unit);
    std::vector<UnitId> done{unit};
    while (!done.empty()) {
      const UnitId u = done.back();
      done.pop_back();
      if (std::erase(todo_, u) > 0) {
        memory_.payloads.Unwant(u);
        --rows_;
      }
      for (const UnitId p : Parents(u)) {
        Need& need = needs_[p];
        if (--need.users > 0) continue;
        if (need.pinned) {
          need.pinned = false;
          memory_.units.Unpin(p);
        } else {
          done.push_back(p);
        }
      }
    }
  }
  // Room for `unit` is worth more than the payloads of what comes after it; false when there were
  // none. Those that others want stay, so that plans cannot take them from each other without end.
  bool GiveUpPayloads(UnitId unit) {
    bool any = false;
    for (const UnitId u : todo_) {
      if (u != unit && memory_.payloads.GiveUp(u)) any = true;
    }
    return any;
  }
  // Hands the target's pin to the caller.
  void Take() { needs_.at(target_).pinned = false; }

 private:
  struct Need {
    uint32_t users = 0;  // units to load that come from it
    bool pinned = false;
    bool from_file = false;
  };
  // That it will be decoded from.
  std::span<const UnitId> Parents(UnitId unit) const {
    const bool decodes = memory_.index.Has(unit) && !needs_.at(unit).from_file;
    return decodes ? memory_.index.parents(unit) : std::span<const UnitId>();
  }
  void Pin(UnitId unit) {
    needs_.at(unit).pinned = true;
    memory_.units.Pin(unit);
  }
  void Clear() {
    for (const auto& [u, need] : needs_) {
      if (need.pinned) memory_.units.Unpin(u);
    }
    for (const UnitId u : todo_) memory_.payloads.Unwant(u);
    todo_.clear();
    needs_.clear();
    rows_ = 0;
  }

  CacheMemory& memory_;
  const UnitId target_;
  std::vector<UnitId> todo_;
  std::ptrdiff_t rows_ = 0;  // of these, in the index
  std::unordered_map<UnitId, Need> needs_;
};

}  // namespace mtdb::internal
