#include "query/internal/moving_cut.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <string>

#include "query/internal/make_room.h"
#include "store/base/out_of_memory.h"

namespace mtdb {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr float kNever = -std::numeric_limits<float>::infinity();  // as a deadline of `low`
constexpr uint32_t kAskEvery = 16;                                 // moves

}  // namespace

float MovingCut::Up(double value) {
  const auto f = static_cast<float>(value);
  return f < value ? std::nextafter(f, std::numeric_limits<float>::infinity()) : f;
}

float MovingCut::Down(double value) {
  const auto f = static_cast<float>(value);
  return f > value ? std::nextafter(f, -std::numeric_limits<float>::infinity()) : f;
}

MovingCut::MovingCut(const ClusterSource& source)
    : source_(source),
      index_(source.index()),
      grid_(source.record().grid),
      rounding_(source.record().rounding_error),
      bounds_(BoundsByCode(grid_, rounding_)),
      units_(source.index().unit_count()) {}

MovingCut::~MovingCut() = default;

const Bits& MovingCut::applied(UnitId unit) const {
  static const Bits kNone;
  const Unit* const u = Find(unit);
  return u == nullptr || u->applied_count == 0 ? kNone : u->applied;
}

Status MovingCut::Inconsistent(UnitId unit, const char* what) const {
  return Corrupt(UnitName(source_.record(), unit) + ": " + what + "; rebuild the object");
}

MovingCut::Unit& MovingCut::Open(UnitId id) {
  auto opened = std::make_unique<Unit>();
  Unit& u = *opened;
  u.id = id;
  const UnitEntry& entry = index_.unit(id);
  const Box3i& bounds = entry.bounds;
  u.box = {grid_.Position(bounds.min), grid_.Position(bounds.max)};
  uint8_t largest = entry.error_code_max;
  const std::span<const UnitId> children = index_.children(id);
  for (const UnitId c : children) largest = std::max(largest, index_.unit(c).error_code_max);
  u.reach = bounds_[largest];
  u.range = threshold_->Range(u.box, u.reach);
  u.activity = ActivityOf(u.box, u.reach);
  u.stale = false;
  u.applied = u.strong = u.known = u.refusing = u.wanted = u.forced_to = u.dirty =
      Bits(entry.nodes);
  u.deadlines.assign(u.known.size(), kNever);
  u.gates.assign(children.size(), kNever);
  // In all lists or in none: Undo goes by them.
  MakeRoomForOne(open_);
  MakeRoomForOne(touched_);
  units_[id] = std::move(opened);
  open_.push_back(id);
  touched_.push_back(id);
  Enqueue(u);
  return u;
}

void MovingCut::Size(Unit& u, const LoadedUnit& unit) const {
  u.first_own = unit.first_own_slot();
  u.present = Bits(unit.own_slots());
  u.refused = Bits(static_cast<uint32_t>(unit.cluster.hole_slots.size()));
  u.sized = true;
}

Result<const LoadedUnit*> MovingCut::Pin(UnitId unit) { return Pin(*Find(unit)); }

// Callers use one unit at a time, so that whatever fits the cache will do.
Result<const LoadedUnit*> MovingCut::Pin(Unit& u) {
  MTDB_RETURN_IF_ERROR(meter_->status());
  MTDB_RETURN_IF_ERROR(reader_->Check());
  if (u.pin != nullptr) return u.pin;
  if (reader_->ShouldRelease()) ReleasePins();
  Result<const LoadedUnit*> unit = reader_->Get(u.id);
  if (!unit.ok() && reader_->crowded()) {
    ReleasePins();
    MTDB_RETURN_IF_ERROR(reader_->WaitForRoom());
    unit = reader_->Get(u.id);
  }
  if (!unit.ok()) return unit;
  if (!u.sized) Size(u, **unit);
  MakeRoomForOne(pinned_);
  pinned_.push_back(u.id);
  u.pin = *unit;
  return u.pin;
}

void MovingCut::ReleasePins() {
  for (const UnitId id : pinned_) {
    if (Unit* const u = Find(id); u != nullptr) u->pin = nullptr;
  }
  pinned_.clear();
  reader_->Release();
}

void MovingCut::Save(Unit& u) {
  if (u.fresh || u.before != nullptr) return;
  auto before = std::make_unique<Flags>(u);
  touched_.push_back(u.id);
  u.before = std::move(before);
}

void MovingCut::Count(Unit& u) {
  const uint32_t forced = u.applied_count == 0 ? 0 : u.applied.CountWithout(u.refusing.words());
  totals_.forced += forced;
  totals_.forced -= u.forced;
  u.forced = forced;
  const bool used = u.applied_count > 0;
  const bool was_used = u.before != nullptr && u.before->applied_count > 0;
  totals_.clusters_used += used ? 1 : 0;
  totals_.clusters_used -= was_used ? 1 : 0;
}

Status MovingCut::EndRoundWith(const Commit& commit) {
  MTDB_RETURN_IF_ERROR(meter_->status());
  for (const UnitId id : touched_) Count(*units_[id]);
  idle_.reserve(idle_.size() + touched_.size());  // nothing may fail after commit
  MTDB_RETURN_IF_ERROR(commit());
  for (const UnitId id : touched_) {
    Unit& u = *units_[id];
    u.before.reset();
    u.fresh = false;
    if (u.applied_count == 0 && index_.unit(id).nodes > 0) idle_.push_back(id);
  }
  touched_.clear();
  totals_before_ = totals_;
  inserted_ = 0;
  return Status::Ok();
}

// What was learnt since the last round is forgotten: all deadlines have passed. Needs no memory.
void MovingCut::Undo() {
  for (const UnitId id : touched_) {
    Unit& u = *units_[id];
    if (u.fresh) {
      units_[id].reset();
    } else {
      static_cast<Flags&>(u) = std::move(*u.before);
      u.before.reset();
    }
  }
  touched_.clear();
  totals_ = totals_before_;
  std::erase_if(open_, [&](UnitId id) { return units_[id] == nullptr; });
  for (const UnitId id : open_) {
    Unit& u = *units_[id];
    u.stale = true;
    u.queued = false;
    u.wanted.ClearAll();
    u.forced_to.ClearAll();
    u.dirty.ClearAll();
    u.arrivals.clear();
    u.todo.clear();
    u.gates_todo.clear();
  }
  queue_.clear();
  todo_.clear();
  for (auto& list : later_) list.clear();
  for (auto& list : later_gates_) list.clear();
}

Status MovingCut::Move(UnitReader& reader, const Query& query, uint64_t round_nodes,
                       const Commit& commit) {
  WorkMeter meter([&reader] { return reader.Check(); });
  reader_ = &reader;
  meter_ = &meter;
  totals_before_ = totals_;
  control_ = query.control;
  inserted_ = inserted_in_all_ = 0;
  evaluated_ = 0;
  const Status status = CatchOutOfMemory([&] { return Step(query, round_nodes, commit); });
  if (!status.ok()) {
    Undo();
  } else {
    CloseIdle();
  }
  ReleasePins();
  reader_ = nullptr;
  meter_ = nullptr;
  control_ = nullptr;
  return status;
}

Status MovingCut::Step(const Query& query, uint64_t round_nodes, const Commit& commit) {
  const bool same = threshold_ != nullptr && asked_ == query.threshold;
  const ThresholdPtr threshold = same ? threshold_ : Attainable(query.threshold, rounding_);
  asked_ = query.threshold;
  const RegionPtr region = query.region == nullptr ? WholeRegion() : query.region;
  const ThresholdPtr old = std::exchange(threshold_, threshold);
  const bool region_moved = std::exchange(region_, region) != region;
  floor_ = 255;  // all that is missing waits
  ++moves_;
  seeds_.clear();
  idle_.clear();
  {
    for (const UnitId id : open_) {
      if (!meter_->Spend(1)) return meter_->status();
      Unit& u = *units_[id];
      if (old == threshold_ && !region_moved && !u.stale) continue;
      bool all = u.stale;
      if (all || region_moved) {
        const Activity was = std::exchange(u.activity, ActivityOf(u.box, u.reach));
        all |= was != u.activity || u.activity == Activity::kSome;
      }
      if (old != threshold_ && !all) {
        const ErrorRange change = old->Change(*threshold_, u.box, u.reach);
        all = !std::isfinite(change.low) || !std::isfinite(change.high);
        u.low += change.low;
        u.high += change.high;
        u.fell = change.low < 0;
        u.rose = change.high > 0;
      }
      u.range = threshold_->Range(u.box, u.reach);
      if (all) u.low = u.high = 0;
      // Now and then a unit that only waits is asked whether it still has to.
      if (u.applied_count == 0 && index_.unit(id).nodes > 0 &&
          (all || (id + moves_) % kAskEvery == 0)) {
        idle_.push_back(id);
      }
      // Nothing was or is active there.
      if (!all && u.activity == Activity::kNone) continue;
      // Until it has been looked at; a failure leaves it so.
      FindExpired(u, all);
      MTDB_RETURN_IF_ERROR(Decide(u));
      u.stale = false;
    }
  }
  MTDB_RETURN_IF_ERROR(Strengthen());
  MTDB_RETURN_IF_ERROR(SuspendAll());
  MTDB_RETURN_IF_ERROR(RemoveUnfounded());
  if (open_.empty()) {
    for (UnitId id = index_.cluster_count(); id < index_.unit_count(); ++id) Open(id);
  }
  return Refine(round_nodes, commit);
}

MovingCut::Activity MovingCut::ActivityOf(const Box3d& box, double reach) const {
  if (region_->whole() || region_->BoxCovers(box, 0)) return Activity::kAll;
  return region_->BoxWithin(box, reach) ? Activity::kSome : Activity::kNone;
}

// What did not fall passes no deadline of `low`, and likewise for `high`: no need to look.
void MovingCut::FindExpired(Unit& u, bool all) {
  expired_.clear();
  expired_gates_.clear();
  const float low = Down(u.low);
  const float high = Up(u.high);
  for (uint32_t w = 0; w < u.known.words().size(); ++w) {
    uint64_t rest = u.known.words()[w];
    if (!all) {
      const float* const deadlines = u.deadlines.data() + size_t{w} * 64;
      const uint64_t refusing = u.refusing.words()[w];
      const uint64_t may_fall = u.fell ? rest & ~refusing : 0;
      const uint64_t may_rise = u.rose ? rest & refusing : 0;
      rest = 0;
      std::array<uint8_t, 64> passed;
      if (may_fall != 0) {
        for (size_t i = 0; i < 64; ++i) passed[i] = low <= deadlines[i] ? 1 : 0;
        rest |= Bits::PackWord(passed.data()) & may_fall;
      }
      if (may_rise != 0) {
        for (size_t i = 0; i < 64; ++i) passed[i] = high >= deadlines[i] ? 1 : 0;
        rest |= Bits::PackWord(passed.data()) & may_rise;
      }
    }
    for (; rest != 0; rest &= rest - 1) {
      expired_.push_back(w * 64 + static_cast<uint32_t>(std::countr_zero(rest)));
    }
  }
  std::erase_if(u.mixed, [&](const Unit::Mixed& m) {
    if (!all && low > m.low && high < m.high) return false;
    if (!all) expired_.push_back(m.node);
    return true;
  });
  for (uint32_t g = 0; g < u.gates.size(); ++g) {
    if (all || low <= u.gates[g]) expired_gates_.push_back(g);
  }
}

Status MovingCut::Decide(Unit& u) {
  if (expired_.empty() && expired_gates_.empty()) return Status::Ok();
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, Pin(u));
  ForEachFetched(*unit, expired_, Fetch::kShapes, [&](NodeIndex node) {
    const bool applied = u.applied.Test(node);
    if (!applied) {
      const std::span<const uint32_t> hole = unit->cluster.hole(node);
      if (std::none_of(hole.begin(), hole.end(),
                       [&](uint32_t slot) { return Present(u, *unit, slot); })) {
        Save(u);
        u.known.Clear(node);
        u.refusing.Clear(node);
        u.refused.ClearRange(unit->cluster.hole_begin[node], unit->cluster.hole_begin[node + 1]);
        return;
      }
    }
    if (Evaluate(u, *unit, node) && applied) {
      u.dirty.Set(node);
      Enqueue(u);
      if (!u.strong.Test(node)) seeds_.push_back(KeyOf(u.id, node));
    }
    if (!applied && u.refusing.Test(node)) Want(u, node, unit->cluster.error_codes[node]);
  });
  for (const uint32_t g : expired_gates_) {
    const UnitId child = unit->children()[g];
    u.gates[g] = kNever;
    if (Find(child) != nullptr) continue;
    later_gates_[LargestCode(child)].emplace_back(u.id, g);
  }
  return Status::Ok();
}

Triangle3d MovingCut::Corners(const LoadedUnit& unit, uint32_t slot) const {
  const std::array<uint32_t, 3> corners = unit.corners(slot, unit.creator(slot));
  const std::vector<Vec3i>& positions = unit.positions();
  return {grid_.Position(positions[corners[0]]), grid_.Position(positions[corners[1]]),
          grid_.Position(positions[corners[2]])};
}

// First by the range of the threshold around all of the unit, then around the hole, whose corners
// are the ring, then triangle by triangle.
MovingCut::Verdict MovingCut::Judge(const Unit& u, const LoadedUnit& unit, NodeIndex node) {
  const double error = bounds_[unit.cluster.error_codes[node]];
  if (u.activity == Activity::kNone) return {false, false, kInfinity, kInfinity};
  meter_->Spend(1);
  const double good = GoodMargin(u);
  if (u.range.low - error >= good) return {false, false, u.range.low - error, kInfinity};
  if (u.activity == Activity::kAll && error - u.range.high >= good && error > u.range.high) {
    return {true, true, kInfinity, error - u.range.high};
  }
  Box3i bounds;
  for (const uint32_t local : unit.cluster.ring(node)) bounds.Add(unit.cluster.position(local));
  const Box3d box{grid_.Position(bounds.min), grid_.Position(bounds.max)};
  const bool all_active = u.activity == Activity::kAll || region_->BoxCovers(box, 0);
  if (!all_active && !region_->BoxWithin(box, error)) return {false, false, kInfinity, kInfinity};
  const ErrorRange range = threshold_->Range(box, error);
  if (error <= range.low) return {false, false, range.low - error, kInfinity};
  if (all_active && error > range.high) return {true, true, kInfinity, error - range.high};
  return JudgeTriangles(unit, node, all_active);
}

MovingCut::Verdict MovingCut::JudgeTriangles(const LoadedUnit& unit, NodeIndex node,
                                             bool all_active) {
  const double error = bounds_[unit.cluster.error_codes[node]];
  const std::span<const uint32_t> hole = unit.cluster.hole(node);
  refusals_.assign(hole.size(), false);
  Verdict verdict{false, true, kInfinity, kInfinity};
  for (size_t i = 0; i < hole.size(); ++i) {
    if (!meter_->Spend(1)) break;
    const Triangle3d t = Corners(unit, hole[i]);
    const bool active = all_active || region_->Within(t, error);
    const double least = active ? threshold_->Min(t, error) : kInfinity;
    if (error <= least) {
      verdict.all = false;
      verdict.fall = std::min(verdict.fall, least - error);
    } else {
      verdict.some = refusals_[i] = true;
      verdict.rise = std::min(verdict.rise, error - least);
    }
  }
  return verdict;
}

// Returns whether what it refuses has changed.
bool MovingCut::Evaluate(Unit& u, const LoadedUnit& unit, NodeIndex node) {
  ++evaluated_;
  const Verdict verdict = Judge(u, unit, node);
  const bool mixed = verdict.some && !verdict.all;
  if (mixed) {
    u.mixed.push_back({node, Up(u.low - verdict.fall), Down(u.high + verdict.rise)});
    u.deadlines[node] = std::numeric_limits<float>::infinity();
  } else {
    u.deadlines[node] = verdict.some ? Down(u.high + verdict.rise) : Up(u.low - verdict.fall);
  }
  const uint32_t begin = unit.cluster.hole_begin[node];
  const uint32_t end = unit.cluster.hole_begin[node + 1];
  bool same = true;
  if (mixed) {
    for (uint32_t i = begin; i < end; ++i) same &= u.refused.Test(i) == refusals_[i - begin];
  } else {
    same = u.refused.CountRange(begin, end) == (verdict.all ? end - begin : 0);
  }
  if (same && u.refusing.Test(node) == verdict.some) return false;
  Save(u);
  u.refused.ClearRange(begin, end);
  if (verdict.all) u.refused.SetRange(begin, end);
  for (uint32_t i = begin; mixed && i < end; ++i) {
    if (refusals_[i - begin]) u.refused.Set(i);
  }
  if (verdict.some) {
    u.refusing.Set(node);
  } else {
    u.refusing.Clear(node);
  }
  return true;
}

bool MovingCut::Present(const Unit& u, const LoadedUnit& unit, uint32_t slot) const {
  if (slot >= u.first_own) return u.present.Test(slot - u.first_own);
  const SlotOrigin& origin = unit.origins[slot];
  const Unit* const parent = Find(unit.parents[origin.parent]);
  return parent != nullptr && parent->sized &&
         parent->present.Test(origin.slot - parent->first_own);
}

void MovingCut::SetPresent(Unit& u, const LoadedUnit& unit, uint32_t slot, bool present) {
  Unit* of = &u;
  uint32_t own = slot - u.first_own;
  if (slot < u.first_own) {
    const SlotOrigin& origin = unit.origins[slot];
    of = Find(unit.parents[origin.parent]);
    own = origin.slot - of->first_own;
    Save(*of);
  }
  if (present) {
    of->present.Set(own);
  } else {
    of->present.Clear(own);
  }
}

Result<NodeIndex> MovingCut::RemoverOf(const LoadedUnit& unit, const Arc& arc) const {
  const uint32_t slot = unit.FindInSlot(arc.parent, arc.slot);
  if (slot == kNone32) return Inconsistent(unit.id, "an arc to it does not arrive");
  return unit.cluster.removers[slot];
}

void MovingCut::Enqueue(Unit& u) {
  if (u.queued) return;
  queue_.insert(u.id);
  u.queued = true;
}

MovingCut::Unit& MovingCut::TakeQueued() {
  Unit& u = *Find(*queue_.begin());
  queue_.erase(queue_.begin());
  u.queued = false;
  return u;
}

}  // namespace mtdb
