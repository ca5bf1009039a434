// SPDX-License-Identifier: Apache-2.0
#include "query/moving/moving_cut.h"

#include <algorithm>

#include "query/cut/fetch_nodes.h"
#include "query/cut/missing_clusters.h"
#include "query/moving/moving_survey.h"
#include "store/base/out_of_memory.h"

namespace mtdb::internal {
namespace {

constexpr uint32_t kAskEvery = 16;  // moves

}  // namespace

MovingCut::MovingCut(const ClusterSource& source)
    : bounds_(source.record().bounds),
      units_(source),
      deadlines_(units_),
      decisions_(units_),
      strength_(units_),
      removal_(units_),
      insertion_(units_, decisions_, strength_) {}

const Bits& MovingCut::applied(UnitId unit) const {
  static const Bits kNone;
  const CutUnit* const u = units_.Find(unit);
  return u == nullptr || u->applied_count == 0 ? kNone : u->applied;
}

template <typename Work>
Status MovingCut::RunWith(UnitReader& reader, Work&& work) {
  WorkMeter meter([&reader] { return reader.Check(); });
  UnitPins pins(units_, reader, meter);
  struct Lent {
    MovingUnits& units;
    ~Lent() {
      units.SetPins(nullptr);
      units.judge().SetMeter(nullptr);
    }
  } const lent{units_};
  units_.judge().SetMeter(&meter);
  units_.SetPins(&pins);
  return work();
}

Status MovingCut::Move(UnitReader& reader, const Query& query, const Goal& goal,
                       uint64_t round_nodes, const Commit& commit) {
  return RunWith(reader, [&] {
    const Status status = CatchOutOfMemory([&] { return Step(query, goal, round_nodes, commit); });
    if (status.code() != StatusCode::kCancelled && goal.last) AskForMissing();
    if (!status.ok()) {
      insertion_.Clear();
      insertion_.ForgetMissing();
      units_.UndoMove();
    } else {
      CloseIdle();
      if (goal.last && reader.available() != nullptr) reader.available()->KeepOnly(units_.open());
    }
    return status;
  });
}

Status MovingCut::MoveTo(UnitReader& reader, const Query& query, const Cutoff& cutoff,
                         uint64_t most, bool first) {
  return Move(reader, query, {cutoff, most, first, false}, 0, [] { return Status::Ok(); });
}

Status MovingCut::EndMoves(UnitReader& reader, bool finds_active, bool complete) {
  return RunWith(reader, [&] {
    AskForMissing();
    if (reader.available() != nullptr) reader.available()->KeepOnly(units_.open());
    if (!finds_active) return Status::Ok();
    return CatchOutOfMemory([&]() -> Status {
      MovingSurvey survey(units_, units_.pins());
      MTDB_ASSIGN_OR_RETURN(active_, survey.Run(complete, bounds_));
      return units_.judge().meter().status();
    });
  });
}

Status MovingCut::Step(const Query& query, const Goal& goal, uint64_t round_nodes,
                       const Commit& commit) {
  decisions_.ResetCount();
  missing_.clear();
  weak_.clear();
  idle_.clear();
  const bool same = units_.judge().Same(query) && units_.judge().cutoff() == goal.cutoff;
  if (!same) insertion_.GiveUp();
  insertion_.Begin(query.control);
  bool moved = false;
  MTDB_RETURN_IF_ERROR(Decide(query, goal.cutoff, &moved));
  if (AvailableUnits* const units = units_.pins().reader().available(); units != nullptr) {
    MTDB_RETURN_IF_ERROR(units->TakeRoot());
  }
  MTDB_RETURN_IF_ERROR(strength_.Run(&weak_));
  MTDB_RETURN_IF_ERROR(removal_.Run(weak_));
  const ClusterIndex& index = units_.index();
  for (UnitId id = index.cluster_count(); id < index.unit_count(); ++id) units_.Open(id);
  // All that waits has been decided upon, unless another query means the same.
  if (moved) insertion_.ForgetMissing();
  insertion_.DeferMissing();
  if (AvailableUnits* const units = units_.pins().reader().available(); units != nullptr) {
    if (goal.first) units->BeginRefining();
  }
  MTDB_RETURN_IF_ERROR(insertion_.Run(round_nodes, goal.most, [&] { return EndRound(commit); }));
  if (insertion_.unfinished()) {
    // Of the whole mesh, which is quick to tell and bounds what the survey would find.
    active_ = {true, units_.counts().triangles, units_.counts().LargestCode(), {}};
    return EndRound(commit);
  }
  if (goal.last) {
    MovingSurvey survey(units_, units_.pins());
    MTDB_ASSIGN_OR_RETURN(active_, survey.Run(true, bounds_));
  }
  return EndRound(commit);
}

// Without memory there is nothing to say, and the next call asks.
void MovingCut::AskForMissing() {
  AvailableUnits* const units = units_.pins().reader().available();
  if (units == nullptr || units_.judge().threshold() == nullptr) return;
  static_cast<void>(CatchOutOfMemory([&]() -> Status {
    missing_ = RankMissing(units_.index(), units_.judge(), *units);
    internal::AskForMissing(units_.index(), units_.judge(), missing_, !insertion_.unfinished(),
                            *units);
    return Status::Ok();
  }));
}

Status MovingCut::Decide(const Query& query, const Cutoff& cutoff, bool* anything_moved) {
  Judge& judge = units_.judge();
  const Judge::Fields from = judge.fields();
  const RegionPtr region = judge.region();
  judge.SetQuery(query, cutoff);
  const Deadlines::Moved moved{&from, region.get(), !(from == judge.fields()),
                               region != judge.region()};
  *anything_moved = moved.threshold || moved.region;
  // Where only the cutoff came along: between both ends of its way.
  const bool passes =
      !moved.region && from.strict == judge.threshold() && from.loose == judge.fields().loose;
  const auto [first, last] = std::minmax(from.from, judge.fields().from);
  ++moves_;
  for (const UnitId id : units_.open()) {
    if (!judge.meter().Spend(1)) return judge.meter().status();
    MovingUnit& u = *units_.Find(id);
    const bool stays = passes && (id < first || id >= last);
    if ((stays || !*anything_moved) && !u.deadlines.stale) continue;
    const Expired& expired = deadlines_.Advance(u, moved);
    // Now and then a unit that only waits is asked whether it still has to.
    if (u.applied_count == 0 && id < units_.index().cluster_count() &&
        (expired.all || (id + moves_) % kAskEvery == 0)) {
      idle_.push_back(id);
    }
    MTDB_RETURN_IF_ERROR(DecideUnit(u, expired, moved));
  }
  return Status::Ok();
}

Status MovingCut::DecideUnit(MovingUnit& u, const Expired& expired, const Deadlines::Moved& moved) {
  if (expired.nodes.empty() && expired.sides.empty() && expired.children.empty()) {
    return Status::Ok();
  }
  return units_.pins().RunOn(u, [&](const LoadedUnit& unit) {
    deadlines_.LookAround(u, unit, moved);
    ForEachFetched(unit, expired.nodes, Fetch::kShapes, [&](NodeIndex node) {
      if (u.applied.Test(node)) {
        if (!decisions_.Evaluate(u, unit, node)) return;
        strength_.Recheck(u, node);
        if (!u.strong.Test(node)) weak_.push_back(KeyOf(u.id, node));
      } else if (units_.AnyPresent(u, unit, node)) {
        decisions_.Evaluate(u, unit, node);
        if (u.refusing.Test(node)) insertion_.Defer(u, node, unit.cluster.error_codes[node]);
      } else {
        decisions_.Forget(u, unit, node);
      }
    });
    for (const uint32_t ordinal : expired.children) {
      const UnitId child = unit.children()[ordinal];
      if (units_.Find(child) == nullptr) insertion_.DeferChild(u, ordinal, child);
    }
    return Status::Ok();
  });
}

Status MovingCut::EndRound(const Commit& commit) {
  MTDB_RETURN_IF_ERROR(units_.judge().meter().status());
  units_.CountRound();
  idle_.reserve(idle_.size() + units_.touched().size());  // nothing may fail after commit
  MTDB_RETURN_IF_ERROR(commit());
  for (const UnitId id : units_.touched()) {
    if (units_.Find(id)->applied_count == 0) idle_.push_back(id);
  }
  units_.EndRound();
  return Status::Ok();
}

// What fails here is done later, or not at all.
void MovingCut::CloseIdle() {
  // Children first, for whose sake parents may be open.
  std::sort(idle_.begin(), idle_.end());
  idle_.erase(std::unique(idle_.begin(), idle_.end()), idle_.end());
  for (const UnitId id : idle_) {
    MovingUnit& u = *units_.Find(id);
    if (u.applied_count > 0 || u.applied.empty()) continue;
    const Status status = CatchOutOfMemory([&] {
      return units_.pins().RunOn(u, [&](const LoadedUnit& unit) {
        if (MayClose(u, unit)) units_.Close(u);
        return Status::Ok();
      });
    });
    if (!status.ok()) break;
  }
  units_.DropClosed();
}

// True when no triangle that enters the unit could be refused with its largest error; its parents
// then keep deadlines for it.
bool MovingCut::MayClose(MovingUnit& u, const LoadedUnit& unit) {
  std::vector<Leeway> margins(unit.parents.size());
  for (uint32_t slot = 0; slot < u.first_own; ++slot) {
    if (!units_.Present(u, unit, slot)) continue;
    const uint32_t p = unit.origins[slot].parent;
    const MovingUnit& parent = *units_.Find(unit.parents[p]);
    const Leeway margin = decisions_.Margin(parent, unit, slot, units_.LargestCode(u.id));
    if (margin.fall < 0) return false;
    margins[p].fall = std::min(margins[p].fall, margin.fall);
    margins[p].shift = std::min(margins[p].shift, margin.shift);
  }
  if (!units_.judge().meter().status().ok()) return false;
  for (size_t p = 0; p < unit.parents.size(); ++p) {
    MovingUnit* const parent = units_.Find(unit.parents[p]);
    if (parent == nullptr) continue;
    const std::span<const UnitId> children = units_.index().children(parent->id);
    const auto at = std::lower_bound(children.begin(), children.end(), u.id);
    parent->deadlines.SetChild(static_cast<uint32_t>(at - children.begin()), margins[p]);
  }
  units_.SetLooked(u, unit, false, [](NodeIndex) {});
  return true;
}

}  // namespace mtdb::internal
