// SPDX-License-Identifier: Apache-2.0
#include "query/session.h"

#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <utility>

#include "query/cache/available_units.h"
#include "query/cache/unit_reader.h"
#include "query/cut/bits.h"
#include "query/cut/search.h"
#include "query/fields/promise.h"
#include "query/fields/stopwatch.h"
#include "query/moving/budget_cut.h"
#include "query/moving/moving_cut.h"
#include "query/moving/update_batches.h"
#include "query/surface.h"
#include "store/base/out_of_memory.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint64_t kRoundNodes = 4096;  // in a round, where there are more to come

UpdateBatches::GetUnit OneByOne(UnitReader& reader) {
  return [&reader](UnitId unit) -> Result<const LoadedUnit*> {
    reader.Release();
    MTDB_RETURN_IF_ERROR(reader.Check());
    return reader.Get(unit);
  };
}

template <typename Take>
auto Releasing(UnitReader& reader, const Take& take) {
  return [&reader, &take](std::vector<UpdateBatch> batches) {
    reader.Release();
    return take(std::move(batches));
  };
}

// From one cut to another.
class Changes {
 public:
  explicit Changes(const Surface& surface)
      : removals_(surface.index(), surface.record().attributes.row_bytes(), false),
        insertions_(surface.index(), surface.record().attributes.row_bytes(), true) {}

  // Empty bits stand for none.
  void AddUnit(UnitId unit, const Bits& before, const Bits& now) {
    removals_.AddUnit(unit, now, before);
    insertions_.AddUnit(unit, before, now);
  }
  uint64_t count() const { return removals_.count() + insertions_.count(); }
  template <typename Take>
  Status Send(const UpdateBatches::GetUnit& get, const Take& take, SessionUpdate* update) {
    std::vector<UpdateBatch> batches;
    MTDB_RETURN_IF_ERROR(removals_.Collect(get, &batches));
    MTDB_RETURN_IF_ERROR(insertions_.Collect(get, &batches));
    MTDB_RETURN_IF_ERROR(take(std::move(batches)));
    update->removals += removals_.count();
    update->insertions += insertions_.count();
    return Status::Ok();
  }

 private:
  UpdateBatches removals_;
  UpdateBatches insertions_;
};

// Which units the nodes are in, and the pieces of the root.
template <typename BitsOf>
std::vector<UnitId> UnitsOf(const ClusterIndex& index, const BitsOf& bits_of) {
  std::vector<UnitId> used;
  for (UnitId u = 0; u < index.unit_count(); ++u) {
    if (u >= index.cluster_count() || !bits_of(u).empty()) used.push_back(u);
  }
  return used;
}

void FillStats(const ObjectRecord& record, const CutState::Counts& counts,
               const ActiveTriangles& active, ExtractStats* stats) {
  stats->triangles = counts.triangles;
  stats->active_triangles = active.count;
  stats->error_bound = BoundOf(record.grid, active.largest_code, record.rounding_error);
  stats->shortfall = active.shortfall;
}

}  // namespace

Session::Session(std::shared_ptr<const Surface> surface, const SessionOptions& options)
    : surface_(std::move(surface)), moving_(std::make_unique<MovingCut>(*surface_->source())) {
  if (!options.available_only) return;
  available_ =
      std::make_unique<UnitReader>(surface_->cache(), ReaderLimits{nullptr, std::nullopt, true});
  available_->available()->Begin(nullptr, std::nullopt);
}

Session::~Session() {
  // Nothing that is on its way is wanted any more.
  if (available_ == nullptr) return;
  static_cast<void>(TryAllocate([&] { available_->available()->Ask({}, true); }));
}

Result<std::unique_ptr<Session>> Session::Open(std::shared_ptr<const Surface> surface,
                                               const SessionOptions& options) {
  MTDB_CHECK(surface != nullptr, "a session needs a surface");
  return CatchOutOfMemory([&]() -> Result<std::unique_ptr<Session>> {
    return std::unique_ptr<Session>(new Session(std::move(surface), options));
  });
}

Result<BaseMesh> Session::Base() const {
  return CatchOutOfMemory([&] { return ReadBase(); });
}

Result<BaseMesh> Session::ReadBase() const {
  const ClusterIndex& index = surface_->index();
  const size_t row_bytes = surface_->record().attributes.row_bytes();
  UnitReader waiting(surface_->cache(), {});
  UnitReader& reader = available_ == nullptr ? waiting : *available_;
  if (available_ != nullptr) MTDB_RETURN_IF_ERROR(TakeRoot());
  BaseMesh base;
  std::unordered_map<VertexIndex, uint32_t> numbers;
  for (UnitId id = index.cluster_count(); id < index.unit_count(); ++id) {
    reader.Release();
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* const unit, reader.Get(id));
    const CompactCluster& piece = unit->cluster;
    std::vector<uint32_t> number_of(piece.vertices.size());
    for (size_t v = 0; v < piece.vertices.size(); ++v) {
      const auto next = static_cast<uint32_t>(base.vertices.size());
      const auto [at, added] = numbers.try_emplace(piece.vertices[v], next);
      number_of[v] = at->second;
      if (!added) continue;
      base.vertices.push_back(piece.vertices[v]);
      base.positions.push_back(piece.positions[v]);
      const auto row = piece.rows.begin() + static_cast<std::ptrdiff_t>(v * row_bytes);
      base.rows.insert(base.rows.end(), row, row + static_cast<std::ptrdiff_t>(row_bytes));
    }
    for (uint32_t t = 0; t < piece.triangles.size(); ++t) {
      const auto& corners = piece.triangles[t];
      base.triangles.push_back(
          {number_of[corners[0]], number_of[corners[1]], number_of[corners[2]]});
      base.triangle_keys.push_back(TriangleKeyOf(id, t));
    }
  }
  return base;
}

Status Session::TakeRoot() const {
  AvailableUnits& units = *available_->available();
  available_->available()->Begin(nullptr, std::nullopt);
  const Status status = units.TakeRoot();
  const std::span<const UnitId> missing = units.missing().list();
  if (!missing.empty()) {
    units.Ask(std::vector<UnitId>(missing.begin(), missing.end()), false);
  }
  return status;
}

void Session::RetryFailed() {
  if (available_ != nullptr) available_->available()->ForgetFailures();
}

TriangleFacts Session::FactsOf(TriangleKey key) const {
  MTDB_CHECK(available_ != nullptr, "only a session that does not wait knows of its triangles");
  const AvailableUnits& units = *available_->available();
  const auto id = static_cast<UnitId>(key >> 32);
  const auto slot = static_cast<uint32_t>(key);
  const ClusterIndex& index = surface_->index();
  const LoadedUnit* const unit = id < index.unit_count() ? units.Find(id) : nullptr;
  MTDB_CHECK(unit != nullptr && slot < unit->cluster.slots(), "no such triangle");
  const ObjectRecord& record = surface_->record();
  const auto facts = [&](uint8_t code, bool exact) {
    return TriangleFacts{BoundOf(record.grid, code, record.rounding_error), exact, id};
  };
  const uint32_t remover = unit->removers()[slot];
  if (remover == kDrain) return facts(0, true);
  if (!RemovedByChild(remover)) return facts(unit->cluster.error_codes[remover], true);
  const UnitId child_id = unit->children()[ChildOrdinal(remover)];
  const LoadedUnit* const child = units.Find(child_id);
  const uint32_t in_slot = child == nullptr ? kNone32 : child->FindInSlot({id, slot});
  if (in_slot == kNone32) {
    return facts(index.Has(child_id) ? index.unit(child_id).error_code_max : 255, false);
  }
  return facts(child->cluster.error_codes[child->removers()[in_slot]], true);
}

Result<SessionUpdate> Session::Update(const Query& query, std::vector<UpdateBatch>* batches) {
  batches->clear();
  return CatchOutOfMemory([&] {
    return Run(query, false, [&](std::vector<UpdateBatch> round) {
      *batches = std::move(round);
      return Status::Ok();
    });
  });
}

Result<SessionUpdate> Session::Update(const Query& query, const BatchSink& sink) {
  return CatchOutOfMemory([&] {
    return Run(query, true, [&](const std::vector<UpdateBatch>& round) { return sink(round); });
  });
}

Result<SessionUpdate> Session::Run(const Query& query, bool rounds, const TakeBatches& take) {
  const Stopwatch watch;
  const ClusterIndex& index = surface_->index();
  const bool waits = available_ == nullptr;
  const bool budget =
      query.max_triangles || query.max_bytes || (waits && query.max_milliseconds.has_value());
  SessionUpdate result;
  ExtractStats& stats = result.stats;
  std::optional<UnitReader> waiting;
  if (waits) {
    waiting.emplace(surface_->cache(), ReaderLimits{query.control, query.max_bytes});
  } else {
    MTDB_RETURN_IF_ERROR(CheckLimits(surface_->record(), query));
    if (!budget) within_query_.reset();
    if (!budget && moving_ != nullptr) available_->available()->Hold({});
    available_->available()->Begin(query.control, DeadlineOf(query));
  }
  UnitReader& reader = waits ? *waiting : *available_;
  if (!budget) {
    MTDB_RETURN_IF_ERROR(Move(reader, query, rounds, take, &result));
  } else if (!waits || (!query.max_bytes && !query.max_milliseconds)) {
    MTDB_RETURN_IF_ERROR(MoveWithin(reader, query, take, &result));
  } else {
    next_.reset();
    within_.reset();
    MTDB_RETURN_IF_ERROR(Select(reader, query, take, &result));
  }
  stats.vertices = index.root_vertices() + applied_count_;
  stats.nodes_applied = applied_count_;
  stats.clusters_total = index.cluster_count();
  reader.FillStats(&stats);
  stats.seconds.select = std::max(0.0, watch.Seconds() - stats.seconds.load);
  return result;
}

Status Session::Move(UnitReader& reader, const Query& query, bool rounds, const TakeBatches& take,
                     SessionUpdate* update) {
  // From a cut that a budget made: a moving cut begins at the root and takes its place at the end,
  // or when it has as many triangles.
  std::unique_ptr<MovingCut> fresh = std::move(next_);
  if (moving_ == nullptr && fresh == nullptr) {
    fresh = std::make_unique<MovingCut>(*surface_->source());
  }
  MovingCut& cut = fresh == nullptr ? *moving_ : *fresh;
  const auto end_round = [&]() -> Status {
    return fresh != nullptr ? Status::Ok() : Follow(cut, take, update);
  };
  MTDB_RETURN_IF_ERROR(
      cut.Move(reader, query, rounds && fresh == nullptr ? kRoundNodes : 0, end_round));
  const bool shows =
      fresh == nullptr || !cut.unfinished() || cut.counts().triangles >= selected_.triangles;
  if (fresh != nullptr && shows) {
    Changes changes(*surface_);
    for (UnitId c = 0; c < selected_.applied.size(); ++c) {
      changes.AddUnit(c, selected_.applied[c], cut.applied(c));
    }
    MTDB_RETURN_IF_ERROR(changes.Send(OneByOne(reader), Releasing(reader, take), update));
    applied_count_ = cut.counts().applied;
    moving_ = std::move(fresh);
    selected_ = {};
    if (available_ != nullptr) available_->available()->Hold({});
  }
  ExtractStats& stats = update->stats;
  stats.missing = cut.missing();
  if (!shows) {
    next_ = std::move(fresh);
    FillStatsOnTheWay(&stats);
    return Status::Ok();
  }
  FillStats(surface_->record(), cut.counts(), cut.active(), &stats);
  stats.nodes_forced = cut.counts().forced;
  stats.clusters_used = cut.counts().clusters_used;
  stats.nodes_visited = cut.evaluated();
  if (!stats.missing.empty()) stats.limit = QueryLimit::kMissing;
  const bool out_of_time = available_ != nullptr && available_->available()->out_of_time();
  if (cut.unfinished() || out_of_time) stats.limit = QueryLimit::kTime;
  return Status::Ok();
}

// The round of a moving cut.
Status Session::Follow(MovingCut& cut, const TakeBatches& take, SessionUpdate* update) {
  Changes changes(*surface_);
  cut.ForEachChange([&](UnitId unit, const Bits& before, const Bits& now) {
    changes.AddUnit(unit, before, now);
  });
  // The last of several rounds may have nothing to add.
  if (changes.count() == 0 && update->insertions + update->removals > 0) return Status::Ok();
  // Whoever takes the batches may take his time: nobody should wait for units meanwhile.
  const auto release_and_take = [&](std::vector<UpdateBatch> batches) {
    cut.ReleasePins();
    return take(std::move(batches));
  };
  const auto get = [&](UnitId unit) { return cut.Pin(unit); };
  const Status taken = changes.Send(get, release_and_take, update);
  if (taken.ok()) applied_count_ = cut.counts().applied;
  return taken;
}

// The client sees where the cut ends, and not the cuts on the way, which may be too large. A query
// that a session did not come to the end of, which does not wait, is ended before a later one
// begins: one that a later query ends would never end where each call has another one.
Status Session::MoveWithin(UnitReader& reader, const Query& query, const TakeBatches& take,
                           SessionUpdate* update) {
  HideCut();
  const uint64_t shown_triangles = selected_.triangles;
  for (;;) {
    const bool goes_on = within_query_.has_value();
    if (!goes_on) within_query_ = query;
    within_query_->control = query.control;
    const Status moved = within_->Move(reader, *within_query_, goes_on, next_.get());
    within_query_->control = nullptr;
    if (!moved.ok()) within_query_.reset();
    MTDB_RETURN_IF_ERROR(moved);
    next_is_shown_ |= within_->done() || next_->counts().triangles >= shown_triangles;
    if (within_->fits() && next_is_shown_) {
      const Status shown = Show(next_->state(), reader, take, update);
      if (!shown.ok()) within_query_.reset();
      MTDB_RETURN_IF_ERROR(shown);
    }
    ExtractStats& stats = update->stats;
    stats.missing = next_->missing();
    const bool answers =
        available_ == nullptr || (within_->done() && next_->Answers(query) &&
                                  within_query_->max_triangles == query.max_triangles);
    if (answers || within_->done()) within_query_.reset();
    if (answers) {
      FillStats(surface_->record(), next_->counts(), next_->active(), &stats);
      stats.clusters_used = selected_.clusters_used;
      if (within_->ended_by_budget()) stats.limit = QueryLimit::kTriangles;
      if (!stats.missing.empty()) stats.limit = QueryLimit::kMissing;
      stats.nodes_visited = within_->evaluated();
      stats.nodes_forced = next_->counts().forced;
      return Status::Ok();
    }
    if (within_query_ || available_->available()->time_is_over()) {
      FillStatsOnTheWay(&stats);
      return Status::Ok();
    }
    available_->available()->Begin(query.control, DeadlineOf(query));
  }
}

// The cut moves on behind what the client has.
void Session::HideCut() {
  if (within_ == nullptr) within_ = std::make_unique<BudgetCut>(*surface_->source());
  if (next_ == nullptr) next_is_shown_ = moving_ != nullptr;
  if (moving_ != nullptr) {
    Selected now;
    now.applied.resize(surface_->index().cluster_count());
    for (UnitId c = 0; c < now.applied.size(); ++c) now.applied[c] = moving_->applied(c);
    now.triangles = moving_->counts().triangles;
    now.clusters_used = moving_->counts().clusters_used;
    now.largest_code = moving_->counts().LargestCode();
    if (available_ != nullptr) {
      available_->available()->Hold(
          UnitsOf(surface_->index(), [&](UnitId c) { return now.applied[c]; }));
    }
    selected_ = std::move(now);
    next_ = std::move(moving_);
  }
  if (next_ == nullptr) next_ = std::make_unique<MovingCut>(*surface_->source());
}

// Under other budgets the cut is not the least one of any query, and cannot move on.
Status Session::Select(UnitReader& reader, const Query& query, const TakeBatches& take,
                       SessionUpdate* update) {
  const ObjectRecord& record = surface_->record();
  CutState cut(*surface_->source(), false);
  Search search(*surface_->source(), reader, query, record.rounding_error, &cut);
  MTDB_ASSIGN_OR_RETURN(const Search::Outcome outcome, search.Run());
  // What the updates need was in the search's reach, or is what the client holds: no budget.
  UnitReader updates(surface_->cache(), {query.control, std::nullopt});
  MTDB_RETURN_IF_ERROR(Show(cut, updates, take, update));
  FillStats(record, cut.counts(), outcome.active, &update->stats);
  update->stats.clusters_used = selected_.clusters_used;
  update->stats.limit = outcome.limit;
  update->stats.nodes_visited = outcome.nodes_visited;
  update->stats.nodes_forced = outcome.nodes_forced;
  return Status::Ok();
}

// The client's cut becomes this one.
Status Session::Show(const CutState& cut, UnitReader& reader, const TakeBatches& take,
                     SessionUpdate* update) {
  const ClusterIndex& index = surface_->index();
  Selected now;
  now.applied.resize(index.cluster_count());
  Changes changes(*surface_);
  for (UnitId c = 0; c < index.cluster_count(); ++c) {
    const CutUnit* const u = cut.Find(c);
    if (u != nullptr && u->applied_count > 0) now.applied[c] = u->applied;
    changes.AddUnit(c, BitsOf(c), now.applied[c]);
    now.clusters_used += now.applied[c].empty() ? 0 : 1;
  }
  now.triangles = cut.counts().triangles;
  now.largest_code = LargestCodeLeft(cut);
  std::vector<UnitId> used;
  if (available_ != nullptr) used = UnitsOf(index, [&](UnitId c) { return now.applied[c]; });
  MTDB_RETURN_IF_ERROR(changes.Send(OneByOne(reader), Releasing(reader, take), update));
  selected_ = std::move(now);
  moving_.reset();
  applied_count_ = cut.counts().applied;
  if (available_ != nullptr) available_->available()->Hold(std::move(used));
  return Status::Ok();
}

uint64_t Session::TrianglesShown() const {
  return moving_ != nullptr ? moving_->counts().triangles : selected_.triangles;
}

// Of the whole mesh that the client has: what it is told of is another query's.
void Session::FillStatsOnTheWay(ExtractStats* stats) const {
  const uint8_t code =
      moving_ != nullptr ? moving_->counts().LargestCode() : selected_.largest_code;
  CutState::Counts counts;
  counts.triangles = TrianglesShown();
  FillStats(surface_->record(), counts, {true, counts.triangles, code, {}}, stats);
  stats->clusters_used =
      moving_ != nullptr ? moving_->counts().clusters_used : selected_.clusters_used;
  stats->limit = QueryLimit::kTime;
}

const Bits& Session::BitsOf(UnitId cluster) const {
  return moving_ == nullptr ? selected_.applied[cluster] : moving_->applied(cluster);
}

bool Session::applied(UnitId cluster, NodeIndex node) const {
  const ClusterIndex& index = surface_->index();
  MTDB_CHECK(
      cluster < index.cluster_count() && (!index.Has(cluster) || node < index.unit(cluster).nodes),
      "no such node");
  const Bits& bits = BitsOf(cluster);
  return !bits.empty() && bits.Test(node);
}

}  // namespace mtdb
