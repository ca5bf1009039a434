// SPDX-License-Identifier: Apache-2.0
#include "query/moving/insertion.h"

#include <algorithm>
#include <numeric>

#include "query/cache/available_units.h"
#include "query/cut/fetch_nodes.h"

namespace mtdb::internal {
namespace {

constexpr uint64_t kRoundShare = 4;  // a round inserts at least this part of all nodes
constexpr int kCodeStep = 8;         // an octave

}  // namespace

void Insertion::Begin(QueryControl* control) {
  unfinished_ = false;
  control_ = control;
  waiting_code_ = 255;
  inserted_ = inserted_before_ = 0;
}

void Insertion::Clear() {
  for (auto& list : nodes_waiting_) list.clear();
  for (auto& list : children_waiting_) list.clear();
  unfinished_ = false;
}

void Insertion::DeferMissing() {
  for (const auto& [id, ordinal] : std::exchange(missing_, {})) {
    MovingUnit* const u = units_.Find(id);
    if (u == nullptr) continue;
    const UnitId child = units_.index().children(id)[ordinal];
    if (units_.Find(child) != nullptr) continue;
    if (units_.pins().reader().IsAvailable(child)) {
      DeferChild(*u, ordinal, child);
    } else {
      missing_.emplace_back(id, ordinal);
    }
  }
}

// What has come and gone is taken note of; all else waits.
Status Insertion::Leave() {
  const auto leave = [&](MovingUnit& u, const LoadedUnit& unit) -> Status {
    const std::vector<uint8_t>& codes = unit.cluster.error_codes;
    const auto reach = [&](NodeIndex node) {
      const bool waits =
          u.known.Test(node) ? u.refusing.Test(node) : decisions_.Learn(u, node, codes[node]);
      if (waits) Defer(u, node, codes[node]);
    };
    if (u.looked) {
      MTDB_RETURN_IF_ERROR(units_.ForEachArrival(u, unit, [&](NodeIndex node) {
        units_.CountArrival(unit, node, 1);
        reach(node);
      }));
    } else {
      units_.SetLooked(u, unit, true, reach);
      if (unit.nodes() == 0) units_.InsertRoot(u, unit);
      u.arrivals.clear();
      u.undecided_children.resize(unit.nodes() == 0 ? unit.children().size() : 0);
      std::iota(u.undecided_children.begin(), u.undecided_children.end(), 0U);
    }
    for (const NodeIndex node : u.undecided) Defer(u, node, codes[node]);
    u.wanted.ForEach([&](NodeIndex node) { Defer(u, node, codes[node]); });
    for (const uint32_t ordinal : u.undecided_children) {
      const UnitId child = unit.children()[ordinal];
      if (units_.Find(child) == nullptr) DeferChild(u, ordinal, child);
    }
    u.undecided.clear();
    u.undecided_children.clear();
    u.wanted.ClearAll();
    return Status::Ok();
  };
  unfinished_ = true;
  return units_.RunQueue(leave);
}

void Insertion::GiveUp() {
  for (const auto* lists : {&nodes_waiting_, &children_waiting_}) {
    for (const auto& list : *lists) {
      for (const auto& [id, what] : list) {
        if (MovingUnit* const u = units_.Find(id); u != nullptr) u->deadlines.stale = true;
      }
    }
  }
  Clear();
}

bool Insertion::TimeIsOver() const {
  const AvailableUnits* const units = units_.pins().reader().available();
  return units != nullptr && units->time_is_over();
}

void Insertion::DeferChild(MovingUnit& u, uint32_t ordinal, UnitId child) {
  u.deadlines.SetChildWaits(ordinal);
  children_waiting_[units_.LargestCode(child)].emplace_back(u.id, ordinal);
}

Status Insertion::Run(uint64_t round_nodes, uint64_t most,
                      const std::function<Status()>& end_round) {
  most_ = most;
  const bool watched = units_.pins().reader().available() != nullptr;
  // What has come and gone only tells what waits: it is no refinement.
  if (watched) MTDB_RETURN_IF_ERROR(RunQueue(false));
  bool stepped = !units_.queue().empty();
  MTDB_RETURN_IF_ERROR(RunQueue(watched));
  while (units_.queue().empty() && !(stepped && TimeIsOver()) && !TooMany() &&
         TakeUp(round_nodes > 0 || watched ? kCodeStep : 256)) {
    stepped = true;
    MTDB_RETURN_IF_ERROR(RunQueue(watched));
    if (round_nodes > 0 &&
        inserted_ >= std::max(round_nodes, units_.counts().applied / kRoundShare)) {
      MTDB_RETURN_IF_ERROR(end_round());
      inserted_before_ += std::exchange(inserted_, 0);
    }
  }
  unfinished_ = !units_.queue().empty() || AnyWaits();
  if (unfinished_) MTDB_RETURN_IF_ERROR(Leave());
  return Status::Ok();
}

bool Insertion::AnyWaits() {
  const auto waits = [&](int code) {
    const auto c = static_cast<size_t>(code);
    return !nodes_waiting_[c].empty() || !children_waiting_[c].empty();
  };
  while (waiting_code_ >= 0 && !waits(waiting_code_)) --waiting_code_;
  return waiting_code_ >= 0;
}

bool Insertion::TakeUp(int step) {
  if (!AnyWaits()) return false;
  const auto take = [&](std::vector<std::pair<UnitId, uint32_t>>& waiting, auto undecided) {
    for (const auto& [id, what] : waiting) {
      // One that was closed since it was left needs nothing.
      MovingUnit* const u = units_.Find(id);
      if (u == nullptr) continue;
      (u->*undecided).push_back(what);
      units_.queue().Add(*u);
    }
    waiting.clear();
  };
  const auto top = static_cast<size_t>(waiting_code_);
  waiting_code_ = std::max(waiting_code_ - step, -1);
  for (size_t code = top + 1; code-- > static_cast<size_t>(waiting_code_ + 1);) {
    take(nodes_waiting_[code], &MovingUnit::undecided);
    take(children_waiting_[code], &MovingUnit::undecided_children);
  }
  return true;
}

// Coarsest units first.
Status Insertion::RunQueue(bool timed) {
  units_.queue().Prefetch(units_.pins().reader(), units_.judge());
  const auto advance = [&](MovingUnit& u, const LoadedUnit& unit) -> Status {
    MTDB_RETURN_IF_ERROR(Advance(u, unit));
    units_.queue().Prefetch(units_.pins().reader(), units_.judge());
    if (control_ != nullptr) {
      control_->nodes_applied_.store(inserted_before_ + inserted_, std::memory_order_relaxed);
    }
    return Status::Ok();
  };
  return units_.RunQueue(advance, [&] { return TooMany() || (timed && TimeIsOver()); });
}

// May be taken again from wherever it fails.
Status Insertion::Advance(MovingUnit& u, const LoadedUnit& unit) {
  if (u.looked) {
    MTDB_RETURN_IF_ERROR(units_.ForEachArrival(u, unit, [&](NodeIndex node) {
      units_.CountArrival(unit, node, 1);
      ReachNode(u, node, unit.cluster.error_codes[node]);
    }));
  } else {
    LookAt(u, unit);
    u.arrivals.clear();
  }
  if (!u.undecided_children.empty()) LookAtChildren(u, unit);
  do {
    nodes_.clear();
    nodes_.swap(u.undecided);
    ForEachFetched(unit, nodes_, Fetch::kShapes, [&](NodeIndex node) {
      if (u.applied.Test(node)) return;
      if (u.Waits(node)) decisions_.Evaluate(u, unit, node);
      if (u.refusing.Test(node)) u.wanted.Set(node);
    });
    nodes_.clear();
    u.wanted.ForEach([&](NodeIndex node) { nodes_.push_back(node); });
    Status status;
    ForEachFetched(unit, nodes_, Fetch::kStars, [&](NodeIndex node) {
      if (status.ok()) status = Insert(u, unit, node);
    });
    MTDB_RETURN_IF_ERROR(status);
    // Those that have become wanted on the way.
    for (NodeIndex n = u.wanted.FirstFrom(0); n != kNone32; n = u.wanted.FirstFrom(n + 1)) {
      MTDB_RETURN_IF_ERROR(Insert(u, unit, n));
    }
  } while (!u.undecided.empty());
  return Status::Ok();
}

// The first look at a unit: all that enters it, or all of a piece of the root.
void Insertion::LookAt(MovingUnit& u, const LoadedUnit& unit) {
  units_.SetLooked(u, unit, true,
                   [&](NodeIndex node) { ReachNode(u, node, unit.cluster.error_codes[node]); });
  if (unit.nodes() > 0) return;
  units_.InsertRoot(u, unit);
  for (uint32_t slot = 0; slot < unit.own_slots(); ++slot) {
    const uint32_t remover = unit.removers()[slot];
    if (RemovedByChild(remover)) ReachChild(u, unit, slot, ChildOrdinal(remover));
  }
}

void Insertion::LookAtChildren(MovingUnit& u, const LoadedUnit& unit) {
  for (const uint32_t ordinal : u.undecided_children) {
    const UnitId child = unit.children()[ordinal];
    const Leeway margin = decisions_.ChildMargin(u, child);
    u.deadlines.SetChild(ordinal, margin);
    if (margin.fall >= 0) continue;
    for (const uint32_t slot : unit.slots_of_child(ordinal)) {
      // A child that has been opened will look for itself.
      if (units_.Find(child) != nullptr) break;
      if (u.present.Test(slot - u.first_own)) ReachChild(u, unit, slot, ordinal);
    }
  }
  u.undecided_children.clear();
}

void Insertion::ReachNode(MovingUnit& u, NodeIndex node, uint8_t code) {
  if (u.known.Test(node)) {
    if (u.refusing.Test(node)) Want(u, node, code);
    return;
  }
  if (!decisions_.Learn(u, node, code)) return;
  if (code <= waiting_code_) {
    Defer(u, node, code);
  } else {
    u.undecided.push_back(node);
    units_.queue().Add(u);
  }
}

// Looks whether the triangle could be refused, with the largest error of the child.
void Insertion::ReachChild(MovingUnit& u, const LoadedUnit& unit, uint32_t slot, uint32_t ordinal) {
  const UnitId id = unit.children()[ordinal];
  if (MovingUnit* const child = units_.Find(id); child != nullptr) {
    units_.queue().Add(*child, {u.id, slot});
    return;
  }
  if (u.deadlines.ChildWaits(ordinal)) return;
  const uint8_t code = units_.LargestCode(id);
  if (code <= waiting_code_) return DeferChild(u, ordinal, id);
  const Leeway margin = decisions_.Margin(u, unit, slot, code);
  if (margin.fall < 0 && units_.pins().reader().IsAvailable(id)) {
    units_.Open(id);
  } else if (margin.fall < 0) {
    missing_.emplace_back(u.id, ordinal);
    u.deadlines.SetChildWaits(ordinal);
  } else {
    u.deadlines.AddChild(ordinal, margin);
  }
}

void Insertion::Want(MovingUnit& u, NodeIndex node, uint8_t code) {
  if (code <= waiting_code_) return Defer(u, node, code);
  u.wanted.Set(node);
  units_.queue().Add(u);
}

// Applies the node if it removes a present refused triangle, after its missing ancestors.
Status Insertion::Insert(MovingUnit& u, const LoadedUnit& unit, NodeIndex node) {
  const std::span<const LocalNumber> hole = unit.cluster.hole(node);
  const uint32_t begin = unit.cluster.hole_begin[node];
  bool refused = false;
  for (uint32_t i = 0; i < hole.size() && !refused; ++i) {
    refused = u.refused.Test(begin + i) && units_.Present(u, unit, hole[i]);
  }
  closure_.clear();
  if (refused) MTDB_RETURN_IF_ERROR(units_.Insert({&u, node}, units_.pins(), &closure_));
  u.wanted.Clear(node);
  inserted_ += closure_.size();
  for (const NodeRef& n : closure_) FollowInsertion(static_cast<MovingUnit&>(*n.unit), n.node);
  return Status::Ok();
}

// Parents come first.
void Insertion::FollowInsertion(MovingUnit& u, NodeIndex node) {
  const LoadedUnit& unit = *u.pin;
  const CompactCluster& cluster = unit.cluster;
  if (!u.known.Test(node) || u.Waits(node)) {
    units_.Save(u);
    u.known.Set(node);
    decisions_.Evaluate(u, unit, node);
  }
  strength_.Find(u, unit, node);
  for (uint32_t slot = cluster.star_begin[node]; slot < cluster.star_begin[node + 1]; ++slot) {
    const uint32_t remover = cluster.removers[slot];
    if (RemovedByNode(remover)) {
      ReachNode(u, remover, cluster.error_codes[remover]);
    } else if (remover != kDrain) {
      ReachChild(u, unit, slot, ChildOrdinal(remover));
    }
  }
}

}  // namespace mtdb::internal
