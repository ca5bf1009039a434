// MovingCut: the nodes that a new query needs besides, and the units that none needs.
#include <algorithm>
#include <limits>

#include "query/internal/moving_cut.h"
#include "store/base/out_of_memory.h"

namespace mtdb {
namespace {

constexpr float kNever = -std::numeric_limits<float>::infinity();
constexpr float kAlways = std::numeric_limits<float>::infinity();
constexpr uint64_t kRoundShare = 4;  // a round inserts at least this part of all nodes
constexpr int kFloorStep = 8;        // codes: an octave
// For a gate the box of the child tells enough when the margin is this share of the range of Min.
constexpr double kGoodShare = 0.1;

}  // namespace

// Nodes of large errors first. That is Search's refinement, and like there the order does not
// matter for where it ends.
Status MovingCut::Refine(uint64_t round_nodes, const Commit& commit) {
  MTDB_RETURN_IF_ERROR(RunQueue());
  while (LowerFloor(round_nodes > 0 ? kFloorStep : 256)) {
    MTDB_RETURN_IF_ERROR(RunQueue());
    if (round_nodes > 0 && inserted_ >= std::max(round_nodes, totals_.applied / kRoundShare)) {
      MTDB_RETURN_IF_ERROR(EndRoundWith(commit));
    }
  }
  MTDB_RETURN_IF_ERROR(Survey());
  return EndRoundWith(commit);
}

// Takes up what waits, by `step` codes; false when nothing does.
bool MovingCut::LowerFloor(int step) {
  const auto waits = [&](int code) {
    const auto c = static_cast<size_t>(code);
    return !later_[c].empty() || !later_gates_[c].empty();
  };
  while (floor_ >= 0 && !waits(floor_)) --floor_;
  if (floor_ < 0) return false;
  const int top = floor_;
  floor_ = std::max(floor_ - step, -1);
  for (int code = top; code > floor_; --code) {
    for (const auto& [id, node] : later_[static_cast<size_t>(code)]) {
      Unit& u = *Find(id);
      u.todo.push_back(node);
      Enqueue(u);
    }
    later_[static_cast<size_t>(code)].clear();
    for (const auto& [id, ordinal] : later_gates_[static_cast<size_t>(code)]) {
      Unit& u = *Find(id);
      u.gates_todo.push_back(ordinal);
      Enqueue(u);
    }
    later_gates_[static_cast<size_t>(code)].clear();
  }
  return true;
}

// Coarsest units first.
Status MovingCut::RunQueue() {
  while (!queue_.empty()) {
    ahead_.clear();
    size_t window = reader_->prefetch_units();
    for (auto it = queue_.begin(); it != queue_.end() && window > 0; ++it, --window) {
      Unit& u = *Find(*it);
      if (u.prefetched) continue;
      u.prefetched = true;
      if (it != queue_.begin()) ahead_.push_back(*it);
    }
    if (!ahead_.empty()) reader_->Prefetch(ahead_);
    Unit& u = TakeQueued();
    MTDB_RETURN_IF_ERROR(Advance(u));
    if (control_ != nullptr) {
      control_->nodes_applied_.store(inserted_in_all_, std::memory_order_relaxed);
    }
  }
  return Status::Ok();
}

Status MovingCut::Advance(Unit& u) {
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
  if (!u.looked) {
    u.looked = true;
    LookAt(u, *unit);
    u.arrivals.clear();
  }
  for (const Arc& arc : u.arrivals) {
    MTDB_ASSIGN_OR_RETURN(const NodeIndex node, RemoverOf(*unit, arc));
    ++totals_.by_code[unit->cluster.error_codes[node]];
    Touch(u, *unit, node);
  }
  u.arrivals.clear();
  if (!u.gates_todo.empty()) PassGates(u, *unit);
  bool waits = false;
  do {
    todo_.swap(u.todo);
    ForEachFetched(*unit, todo_, Fetch::kShapes, [&](NodeIndex node) {
      if (u.applied.Test(node)) return;
      if (Unjudged(u, node)) Evaluate(u, *unit, node);
      if (u.refusing.Test(node)) u.wanted.Set(node);
    });
    todo_.clear();
    u.wanted.ForEach([&](NodeIndex node) { todo_.push_back(node); });
    Status status;
    ForEachFetched(*unit, todo_, Fetch::kStars, [&](NodeIndex node) {
      if (status.ok()) status = Insert(u, *unit, node, &waits);
    });
    todo_.clear();
    MTDB_RETURN_IF_ERROR(status);
    // Those that have become wanted on the way.
    for (NodeIndex n = u.wanted.FirstFrom(0); n != kNone32; n = u.wanted.FirstFrom(n + 1)) {
      MTDB_RETURN_IF_ERROR(Insert(u, *unit, n, &waits));
    }
  } while (!u.todo.empty());
  if (waits) Enqueue(u);  // the parents that it waits for come first
  return Status::Ok();
}

// The first look at a unit: all that enters it, and what is there without a node.
void MovingCut::LookAt(Unit& u, const LoadedUnit& unit) {
  for (uint32_t slot = 0; slot < u.first_own; ++slot) {
    if (!Present(u, unit, slot)) continue;
    const NodeIndex node = unit.cluster.removers[slot];
    --totals_.by_code[LargestCode(u.id)];
    ++totals_.by_code[unit.cluster.error_codes[node]];
    Touch(u, unit, node);
  }
  const uint32_t listed = unit.cluster.listed() - u.first_own;
  u.present.SetRange(0, listed);
  totals_.triangles += listed;
  for (uint32_t slot = u.first_own; slot < unit.cluster.listed(); ++slot) {
    const uint32_t remover = unit.cluster.removers[slot];
    if (RemovedByChild(remover)) {
      ++totals_.by_code[LargestCode(unit.children()[ChildOrdinal(remover)])];
      PassGate(u, unit, slot, ChildOrdinal(remover));
    } else {
      ++totals_.by_code[0];
    }
  }
}

// One of the triangles that the node removes has become present. For Advance, which goes on with
// `todo`.
void MovingCut::Touch(Unit& u, const LoadedUnit& unit, NodeIndex node) {
  const uint8_t code = unit.cluster.error_codes[node];
  if (!u.known.Test(node)) {
    Save(u);
    u.known.Set(node);
    // Most are valid by far, and their code says so.
    if (const double fall = u.range.low - bounds_[code]; fall >= GoodMargin(u)) {
      ++evaluated_;
      u.deadlines[node] = Up(u.low - fall);
      return;
    }
    u.deadlines[node] = kAlways;
    if (code <= floor_) {
      later_[code].emplace_back(u.id, node);
    } else {
      u.todo.push_back(node);
    }
    return;
  }
  if (u.refusing.Test(node)) Want(u, node, code);
}

void MovingCut::Want(Unit& u, NodeIndex node, uint8_t code) {
  if (code <= floor_) {
    later_[code].emplace_back(u.id, node);
    return;
  }
  u.wanted.Set(node);
  Enqueue(u);
}

// Applies the node if it removes a present refused triangle, or must; before it what is missing of
// its ancestors in the unit. Those in other units are asked for, and the node waits.
Status MovingCut::Insert(Unit& u, const LoadedUnit& unit, NodeIndex target, bool* waits) {
  const Cluster& cluster = unit.cluster;
  if (!u.applied.Test(target) && !u.forced_to.Test(target)) {
    const std::span<const uint32_t> hole = cluster.hole(target);
    const uint32_t begin = cluster.hole_begin[target];
    bool reason = false;
    for (uint32_t i = 0; i < hole.size() && !reason; ++i) {
      reason = u.refused.Test(begin + i) && Present(u, unit, hole[i]);
    }
    if (!reason) {
      u.wanted.Clear(target);
      return Status::Ok();
    }
  }
  missing_.assign(1, target);
  while (!missing_.empty()) {
    const NodeIndex node = missing_.back();
    const size_t depth = missing_.size();
    bool blocked = false;
    if (!u.applied.Test(node)) {
      for (const uint32_t slot : cluster.hole(node)) {
        if (Present(u, unit, slot)) continue;
        Unit* of = &u;
        NodeIndex creator = 0;
        if (slot >= u.first_own) {
          creator = unit.creator(slot);
        } else {
          const SlotOrigin& origin = unit.origins[slot];
          const UnitId parent = unit.parents[origin.parent];
          creator = origin.creator;
          of = Find(parent);
          if (of == nullptr && creator != kNone32) of = &Open(parent);
        }
        if (creator == kNone32 || of->applied.Test(creator)) {
          return Inconsistent(unit.id, "two nodes remove one triangle");
        }
        if (of == &u) {
          missing_.push_back(creator);
          continue;
        }
        of->wanted.Set(creator);
        of->forced_to.Set(creator);
        Enqueue(*of);
        blocked = true;
      }
      if (blocked) {
        u.forced_to.Set(target);
        *waits = true;
        return Status::Ok();
      }
      if (missing_.size() > depth) continue;
      Apply(u, unit, node);
    }
    missing_.pop_back();
  }
  u.wanted.Clear(target);
  u.forced_to.Clear(target);
  return Status::Ok();
}

// The hole is present.
void MovingCut::Apply(Unit& u, const LoadedUnit& unit, NodeIndex node) {
  Save(u);
  const Cluster& cluster = unit.cluster;
  const std::span<const uint32_t> hole = cluster.hole(node);
  for (const uint32_t slot : hole) SetPresent(u, unit, slot, false);
  const uint32_t begin = cluster.star_begin[node];
  const uint32_t end = cluster.star_begin[node + 1];
  u.present.SetRange(begin - u.first_own, end - u.first_own);
  u.applied.Set(node);
  ++u.applied_count;
  ++totals_.applied;
  ++inserted_;
  ++inserted_in_all_;
  totals_.triangles += end - begin;
  totals_.triangles -= hole.size();
  totals_.by_code[cluster.error_codes[node]] -= hole.size();
  if (!u.known.Test(node) || Unjudged(u, node)) {
    u.known.Set(node);
    Evaluate(u, unit, node);
  }
  if (IsStrong(u, unit, node)) {
    u.strong.Set(node);
  } else {
    u.strong.Clear(node);
  }
  for (uint32_t slot = begin; slot < end; ++slot) {
    const uint32_t remover = cluster.removers[slot];
    if (RemovedByNode(remover)) {
      ++totals_.by_code[cluster.error_codes[remover]];
      Touch(u, unit, remover);
    } else if (remover == kDrain) {
      ++totals_.by_code[0];
    } else {
      // A child that has looked around counts what arrives.
      const UnitId id = cluster.children[ChildOrdinal(remover)];
      const Unit* const child = Find(id);
      if (child == nullptr || !child->looked) ++totals_.by_code[LargestCode(id)];
      PassGate(u, unit, slot, ChildOrdinal(remover));
    }
  }
}

void MovingCut::PassGates(Unit& u, const LoadedUnit& unit) {
  gates_open_.assign(u.gates.size(), false);
  bool any = false;
  for (const uint32_t ordinal : u.gates_todo) {
    const UnitId child = unit.children()[ordinal];
    if (!meter_->Spend(1)) return;
    const double error = bounds_[LargestCode(child)];
    const Box3i& bounds = index_.unit(child).bounds;
    const ErrorRange range =
        threshold_->Range({grid_.Position(bounds.min), grid_.Position(bounds.max)}, error);
    const double fall = range.low - error;
    gates_open_[ordinal] = !(fall >= kGoodShare * (range.high - range.low));
    u.gates[ordinal] = gates_open_[ordinal] ? kNever : Up(u.low - fall);
    any |= gates_open_[ordinal];
  }
  u.gates_todo.clear();
  if (!any) return;
  const std::vector<uint32_t>& removers = unit.removers();
  u.present.ForEach([&](uint32_t own) {
    const uint32_t remover = removers[own + u.first_own];
    if (!RemovedByChild(remover) || !gates_open_[ChildOrdinal(remover)]) return;
    const UnitId child = unit.children()[ChildOrdinal(remover)];
    // A child that has been opened meanwhile will look for itself.
    if (Find(child) == nullptr) PassGate(u, unit, own + u.first_own, ChildOrdinal(remover));
  });
}

// A present triangle that a child removes: looks whether it could be refused, with the largest
// error of the child.
void MovingCut::PassGate(Unit& u, const LoadedUnit& unit, uint32_t slot, uint32_t ordinal) {
  const UnitId id = unit.children()[ordinal];
  if (Unit* const child = Find(id); child != nullptr) {
    child->arrivals.push_back({u.id, slot});
    Enqueue(*child);
    return;
  }
  if (u.gates[ordinal] == kAlways) return;  // it waits
  const uint8_t code = LargestCode(id);
  if (code <= floor_) {
    u.gates[ordinal] = kAlways;
    later_gates_[code].emplace_back(u.id, ordinal);
    return;
  }
  const double margin = GateMargin(u, unit, slot, bounds_[code]);
  if (margin < 0) {
    Open(id);
  } else {
    u.gates[ordinal] = std::max(u.gates[ordinal], Up(u.low - margin));
  }
}

// By how much the threshold has to fall before the triangle is refused, at this error; negative
// when it is.
double MovingCut::GateMargin(const Unit& u, const LoadedUnit& unit, uint32_t slot,
                             double error) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  if (u.activity == Activity::kNone || !meter_->Spend(1)) return kInfinity;
  if (error <= u.range.low) return u.range.low - error;
  if (u.activity == Activity::kAll && error > u.range.high) return -1;
  const Triangle3d t = Corners(unit, slot);
  if (u.activity == Activity::kSome && !region_->Within(t, error)) return kInfinity;
  const double least = threshold_->Min(t, error);
  return error <= least ? least - error : -1;
}

// Which triangles are active: where there is a region, all of its mesh is looked at.
Status MovingCut::Survey() {
  active_ = {};
  const bool shortfall = MayFallShort(asked_, source_.record().bounds, rounding_);
  if (region_->whole() && !shortfall) {
    active_.triangles = totals_.triangles;
    for (size_t code = 0; code < 256; ++code) {
      if (totals_.by_code[code] > 0) active_.largest_code = static_cast<uint8_t>(code);
    }
    return Status::Ok();
  }
  for (const UnitId id : open_) {
    Unit& u = *units_[id];
    if (u.activity == Activity::kNone) continue;
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
    SurveyUnit(u, *unit, shortfall);
  }
  return Status::Ok();
}

// What enters the unit, and what it creates but for open children.
void MovingCut::SurveyUnit(const Unit& u, const LoadedUnit& unit, bool shortfall) {
  const auto survey = [&](uint32_t slot, uint8_t code) {
    if (!meter_->Spend(1)) return;
    if (u.activity == Activity::kSome && !region_->Within(Corners(unit, slot), bounds_[code])) {
      return;
    }
    ++active_.triangles;
    active_.largest_code = std::max(active_.largest_code, code);
    if (shortfall && !(u.range.low > bounds_[code])) {
      AddShortfall(*asked_, Corners(unit, slot), bounds_[code], unit.removers()[slot] != kDrain,
                   &active_.shortfall);
    }
  };
  for (uint32_t slot = 0; slot < u.first_own; ++slot) {
    if (!Present(u, unit, slot)) continue;
    survey(slot, unit.cluster.error_codes[unit.cluster.removers[slot]]);
  }
  u.present.ForEach([&](uint32_t own) {
    const uint32_t slot = own + u.first_own;
    const uint32_t remover = unit.removers()[slot];
    if (RemovedByNode(remover)) {
      survey(slot, unit.cluster.error_codes[remover]);
    } else if (remover == kDrain) {
      survey(slot, 0);
    } else if (const UnitId child = unit.children()[ChildOrdinal(remover)];
               Find(child) == nullptr) {
      survey(slot, LargestCode(child));
    }
  });
}

// What fails here is done later, or not at all.
void MovingCut::CloseIdle() {
  // Children first, for whose sake parents may be open.
  std::sort(idle_.begin(), idle_.end());
  idle_.erase(std::unique(idle_.begin(), idle_.end()), idle_.end());
  bool closed = false;
  for (const UnitId id : idle_) {
    Unit& u = *Find(id);
    if (u.applied_count > 0) continue;
    const Status status = CatchOutOfMemory([&]() -> Status {
      MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
      closed |= Close(u, *unit);
      return Status::Ok();
    });
    if (!status.ok()) break;
  }
  if (closed) std::erase_if(open_, [&](UnitId id) { return units_[id] == nullptr; });
}

// Closes a unit without applied nodes when no triangle that enters it could be refused with its
// largest error.
bool MovingCut::Close(Unit& u, const LoadedUnit& unit) {
  const double error = bounds_[LargestCode(u.id)];
  std::vector<double> margins(unit.parents.size(), std::numeric_limits<double>::infinity());
  for (uint32_t slot = 0; slot < u.first_own; ++slot) {
    if (!Present(u, unit, slot)) continue;
    const uint32_t p = unit.origins[slot].parent;
    const Unit& parent = *Find(unit.parents[p]);
    const double margin = GateMargin(parent, unit, slot, error);
    if (margin < 0) return false;
    margins[p] = std::min(margins[p], margin);
  }
  if (!meter_->status().ok()) return false;
  for (size_t p = 0; p < unit.parents.size(); ++p) {
    Unit* const parent = Find(unit.parents[p]);
    if (parent == nullptr) continue;
    const std::span<const UnitId> children = index_.children(parent->id);
    const auto at = std::lower_bound(children.begin(), children.end(), u.id);
    parent->gates[static_cast<size_t>(at - children.begin())] = Up(parent->low - margins[p]);
  }
  for (uint32_t slot = 0; slot < u.first_own; ++slot) {
    if (!Present(u, unit, slot)) continue;
    --totals_.by_code[unit.cluster.error_codes[unit.cluster.removers[slot]]];
    ++totals_.by_code[LargestCode(u.id)];
  }
  units_[u.id].reset();
  return true;
}

}  // namespace mtdb
