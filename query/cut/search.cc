// SPDX-License-Identifier: Apache-2.0
#include "query/cut/search.h"

#include <algorithm>
#include <chrono>

#include "query/cache/available_units.h"
#include "query/cut/missing_clusters.h"

namespace mtdb::internal {

std::optional<std::chrono::steady_clock::time_point> DeadlineOf(const Query& query) {
  if (!query.max_milliseconds) return std::nullopt;
  const std::chrono::duration<double, std::milli> budget(
      std::clamp(*query.max_milliseconds, 0.0, 1e12));
  return std::chrono::steady_clock::now() +
         std::chrono::duration_cast<std::chrono::nanoseconds>(budget);
}

Status CheckLimits(const ObjectRecord& record, const Query& query) {
  if (!query.max_bytes) return Status::Ok();
  return InvalidArgument(record.name +
                         ": a query that takes what is there reads nothing: ask without a limit of "
                         "bytes");
}

// Why the order of work does not matter: activity and validity belong to a triangle, not to the
// cut, and a node that removes an active invalid triangle of the current mesh is in every valid
// cut. So whatever is applied must be, and what remains when nothing is left to apply is the least
// valid cut.

Search::Search(const ClusterSource& source, UnitReader& reader, const Query& query, double rounding,
               CutState* cut)
    : index_(source.index()),
      bounds_(source.record().bounds),
      query_(query),
      cut_(*cut),
      meter_([&reader] { return reader.Check(); }),
      pins_(*cut, reader, meter_),
      judge_(source, rounding),
      pass_(*cut, judge_),
      by_level_(query.max_triangles || query.max_bytes || query.max_milliseconds),
      queue_(*cut),
      pending_(source.index().unit_count()) {
  judge_.SetQuery(query);
  judge_.SetMeter(&meter_);
  if (by_level_) {
    level_.cutoff = {judge_.levels().top(), index_.unit_count()};
    level_.looks.assign(judge_.levels().in_pixels() ? index_.unit_count() : 0, 0);
  }
}

Result<Search::Outcome> Search::Run() {
  Status status = RunFromRoot();
  pins_.reader().SetDeadline(std::nullopt);
  meter_.Resume();
  if (status.ok() && outcome_.limit == QueryLimit::kTriangles) status = TakeBackLevel();
  if (status.code() != StatusCode::kCancelled) AskForMissing();
  MTDB_RETURN_IF_ERROR(status);
  Survey survey(cut_, judge_, pins_);
  MTDB_ASSIGN_OR_RETURN(outcome_.active,
                        survey.Run(outcome_.limit == QueryLimit::kThreshold, bounds_));
  pins_.Release();
  return std::move(outcome_);
}

void Search::AskForMissing() {
  AvailableUnits* const units = pins_.reader().available();
  if (units == nullptr) return;
  outcome_.missing = RankMissing(index_, judge_, *units);
  internal::AskForMissing(index_, judge_, outcome_.missing, true, *units);
  // A budget may be spent better when what is missing has come.
  const bool ended =
      outcome_.limit == QueryLimit::kThreshold || outcome_.limit == QueryLimit::kTriangles;
  if (ended && !outcome_.missing.empty()) outcome_.limit = QueryLimit::kMissing;
}

Status Search::RunFromRoot() {
  const auto deadline = DeadlineOf(query_);
  MTDB_RETURN_IF_ERROR(OpenRoot());
  pins_.reader().SetDeadline(deadline);
  return by_level_ ? RunByLevel() : RunByClusters();
}

Status Search::OpenRoot() {
  if (AvailableUnits* const units = pins_.reader().available(); units != nullptr) {
    MTDB_RETURN_IF_ERROR(units->TakeRoot());
  }
  for (UnitId id = index_.cluster_count(); id < index_.unit_count(); ++id) {
    CutUnit& u = cut_.Open(id);
    MTDB_RETURN_IF_ERROR(pins_.RunOn(u, [&](const LoadedUnit& unit) {
      cut_.InsertRoot(u, unit);
      ExamineOutSlots(unit, u);
      return Status::Ok();
    }));
  }
  return Status::Ok();
}

template <typename Step>
Status Search::RunStep(Step&& step) {
  const Status status = pins_.Run(step);
  if (query_.control != nullptr) {
    query_.control->nodes_applied_.store(cut_.counts().applied, std::memory_order_relaxed);
  }
  return status;
}

Status Search::RunByClusters() {
  while (!queue_.empty()) {
    queue_.Prefetch(pins_.reader(), judge_);
    CutUnit& u = queue_.Take();
    MTDB_RETURN_IF_ERROR(RunStep([&] { return Advance(u); }));
  }
  return Status::Ok();
}

Status Search::Advance(CutUnit& u) {
  if (pending_.Test(u.id)) MTDB_RETURN_IF_ERROR(LookAt(u));
  for (NodeIndex n = u.wanted.FirstFrom(0); n != kNone32; n = u.wanted.FirstFrom(n + 1)) {
    if (!meter_.Spend(1)) return meter_.status();
    MTDB_RETURN_IF_ERROR(Insert({&u, n}));
    u.wanted.Clear(n);
  }
  return Status::Ok();
}

Status Search::LookAt(CutUnit& u) {
  if (!pins_.reader().IsAvailable(u.id)) {
    // It stays pending, so that what enters it later does not bring it back.
    return Status::Ok();
  }
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, pins_.Pin(u));
  const auto examine = [&](uint32_t slot) {
    if (cut_.Present(u, *unit, slot)) ExamineSlot(*unit, u, slot, kNone32);
  };
  pending_.Clear(u.id);
  if (!u.looked) {
    u.looked = true;
    outcome_.nodes_visited += unit->nodes();
    if (by_level_) {
      for (uint32_t slot = 0; slot < u.first_own; ++slot) examine(slot);
    } else {
      outcome_.nodes_forced += pass_.Run(u, *unit);
      ExamineOutSlots(*unit, u);
    }
    return Status::Ok();
  }
  for (const Arc& arc : u.arrivals) {
    MTDB_ASSIGN_OR_RETURN(const uint32_t slot, cut_.InSlotOf(*unit, arc));
    examine(slot);
  }
  u.arrivals.clear();
  return Status::Ok();
}

// A level is left when all that is wanted at it, or above, is there: the cut is then the least one
// for its cutoff, whatever the order was.
void Search::EnterLevel(const LevelTask& task) {
  Cutoff& c = level_.cutoff;
  if (task.level > c.level || (task.level == c.level && task.unit >= c.from)) return;
  c = {task.level, task.unit};
  level_.inserted.clear();
  level_.forced_before = outcome_.nodes_forced;
}

Status Search::TakeBackLevel() {
  const auto take_back = [&](const NodeRef& n) {
    return pins_.RunOn(*n.unit, [&](const LoadedUnit& unit) {
      cut_.Remove(*n.unit, unit, n.node);
      return Status::Ok();
    });
  };
  for (size_t i = level_.inserted.size(); i-- > 0;) {
    MTDB_RETURN_IF_ERROR(take_back(level_.inserted[i]));
  }
  level_.inserted.clear();
  outcome_.nodes_forced = level_.forced_before;
  return Status::Ok();
}

Status Search::RunByLevel() {
  QueryLimit& limit = outcome_.limit;
  UnitReader& reader = pins_.reader();
  while (!level_.queue.empty() && limit == QueryLimit::kThreshold) {
    const LevelTask task = level_.queue.Pop();
    EnterLevel(task);
    const Status status = RunStep([&] { return RunTask(task); });
    if (reader.out_of_bytes()) {
      limit = QueryLimit::kBytes;
    } else if (reader.out_of_time()) {
      limit = QueryLimit::kTime;
    } else {
      MTDB_RETURN_IF_ERROR(status);
    }
  }
  return Status::Ok();
}

Status Search::RunTask(const LevelTask& task) {
  UnitReader& reader = pins_.reader();
  CutUnit& u = cut_.Open(task.unit);
  if (!task.look) return Insert({&u, task.node});
  if (!pending_.Test(task.unit)) return Status::Ok();  // it has been, at a higher level
  if (query_.max_bytes && !reader.MayRead(task.unit)) {
    outcome_.limit = QueryLimit::kBytes;
    return Status::Ok();
  }
  return LookAt(u);
}

Status Search::Insert(NodeRef target) {
  inserted_.clear();
  MTDB_RETURN_IF_ERROR(cut_.Insert(target, pins_, &inserted_));
  if (inserted_.empty()) return Status::Ok();
  if (query_.max_triangles && cut_.counts().triangles > *query_.max_triangles) {
    outcome_.limit = QueryLimit::kTriangles;
    cut_.TakeBack(inserted_);
    return Status::Ok();
  }
  if (query_.max_triangles) {
    level_.inserted.insert(level_.inserted.end(), inserted_.begin(), inserted_.end());
  }
  for (const NodeRef& n : std::span(inserted_).first(inserted_.size() - 1)) {
    outcome_.nodes_forced += judge_.RefusesAny(*n.unit->pin, n.node) ? 0 : 1;
  }
  for (const NodeRef& n : inserted_) ExamineStar(n);
  return Status::Ok();
}

void Search::ExamineOutSlots(const LoadedUnit& unit, CutUnit& u) {
  const std::vector<UnitId>& children = unit.children();
  decided_.assign(children.size(), false);
  size_t open = children.size();
  const auto decide = [&](size_t ordinal) {
    decided_[ordinal] = true;
    --open;
  };
  for (size_t i = 0; i < children.size(); ++i) {
    const UnitEntry& child = index_.unit(children[i]);
    if (!judge_.MayRefuse(child.bounds, child.error_code_max)) decide(i);
  }
  for (uint32_t own = u.present.FirstFrom(0); own != kNone32 && open > 0;
       own = u.present.FirstFrom(own + 1)) {
    const uint32_t slot = own + u.first_own;
    const uint32_t remover = unit.removers()[slot];
    if (!RemovedByChild(remover) || decided_[ChildOrdinal(remover)]) continue;
    const UnitId child = children[ChildOrdinal(remover)];
    ExamineOutSlot(unit, u, slot, judge_.by_code() ? kNone32 : unit.creator(slot));
    // Pending for the first time: it will see all its in-triangles itself.
    if (!by_level_ && pending_.Test(child) && !cut_.Looked(child)) decide(ChildOrdinal(remover));
  }
}

void Search::ExamineStar(NodeRef node) {
  CutUnit& u = *node.unit;
  const LoadedUnit& unit = *u.pin;
  const CompactCluster& cluster = unit.cluster;
  for (uint32_t slot = cluster.star_begin[node.node]; slot < cluster.star_begin[node.node + 1];
       ++slot) {
    if (u.present.Test(slot - u.first_own)) ExamineSlot(unit, u, slot, node.node);
  }
}

void Search::ExamineSlot(const LoadedUnit& unit, CutUnit& u, uint32_t slot, NodeIndex creator) {
  const uint32_t remover = unit.removers()[slot];
  if (!RemovedByNode(remover)) return ExamineOutSlot(unit, u, slot, creator);
  const uint8_t code = unit.cluster.error_codes[remover];
  if (by_level_) {
    const int level = judge_.LevelOf(unit, slot, creator, code);
    if (level != Levels::kNone) Want(u, remover, level);
  } else if (judge_.Refused(unit, slot, creator, code)) {
    Want(u, remover, 0);
  }
}

void Search::ExamineOutSlot(const LoadedUnit& unit, CutUnit& u, uint32_t slot, NodeIndex creator) {
  const uint32_t remover = unit.removers()[slot];
  if (remover == kDrain) return;
  const UnitId id = unit.children()[ChildOrdinal(remover)];
  const bool pending = pending_.Test(id);
  const bool asks_level = by_level_ && (!pending || !level_.looks.empty());
  // The first look at a cluster passes all its in-triangles, later ones only its arrivals.
  if (pending && !cut_.Looked(id) && !asks_level) return;
  const uint8_t largest = cut_.LargestCode(id);
  if (largest <= judge_.valid_code()) return;
  const int level = asks_level ? judge_.LevelOf(unit, slot, creator, largest) : Levels::kNone;
  if (!pending) {
    if (by_level_ ? level == Levels::kNone : !judge_.Refused(unit, slot, creator, largest)) return;
  }
  CutUnit& child = cut_.Open(id);
  if (child.looked) child.arrivals.push_back({u.id, slot});
  const bool waits = pending && (level_.looks.empty() || level <= level_.looks[id]);
  pending_.Set(id);
  if (waits) return;
  if (by_level_) {
    if (!level_.looks.empty()) level_.looks[id] = static_cast<int16_t>(level);
    level_.queue.Push({level, true, id, 0});
  } else {
    queue_.Add(child);
  }
}

// In pixels each of the triangles that a node removes has its level; the highest comes first.
void Search::Want(CutUnit& u, NodeIndex node, int level) {
  if (u.wanted.Test(node) && level_.looks.empty()) return;
  u.wanted.Set(node);
  if (by_level_) {
    level_.queue.Push({level, false, u.id, node});
  } else {
    queue_.Add(u);
  }
}

}  // namespace mtdb::internal
