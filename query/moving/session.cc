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
#include <variant>
#include <vector>

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

void FillStats(const ObjectRecord& record, const CutState::Counts& counts,
               const ActiveTriangles& active, ExtractStats* stats) {
  stats->triangles = counts.triangles;
  stats->active_triangles = active.count;
  stats->error_bound = BoundOf(record.grid, active.largest_code, record.rounding_error);
  stats->shortfall = active.shortfall;
}

// What a client has that no moving cut holds.
struct Selected {
  std::vector<Bits> applied;  // per cluster, empty where no node is
  uint64_t nodes = 0, triangles = 0, clusters_used = 0;
  uint8_t largest_code = 0;  // of the whole mesh

  Selected(const CutState& cut, uint8_t largest)
      : applied(cut.index().cluster_count()),
        nodes(cut.counts().applied),
        triangles(cut.counts().triangles),
        largest_code(largest) {
    for (UnitId c = 0; c < applied.size(); ++c) {
      const CutUnit* const u = cut.Find(c);
      if (u == nullptr || u->applied_count == 0) continue;
      applied[c] = u->applied;
      ++clusters_used;
    }
  }
};

// The units that nodes are applied of, and the pieces of the root.
std::vector<UnitId> UnitsOf(const ClusterIndex& index, const Selected& selected) {
  std::vector<UnitId> used;
  for (UnitId u = 0; u < index.unit_count(); ++u) {
    if (u >= index.cluster_count() || !selected.applied[u].empty()) used.push_back(u);
  }
  return used;
}

}  // namespace

// Where a session is between updates, and where an update leads:
//
//               no budget             max_triangles    other budgets (of a session that waits)
//   AtCut       AtCut                 Hidden           Selected
//   Selected    Hidden, then AtCut    Hidden           Selected
//   Hidden      Hidden, then AtCut    Hidden           Selected
//
// A session begins at the root: AtCut. After Hidden it comes to AtCut when the hidden cut is that
// of the query, or as large as what the client has; one that waits does so in the same update. An
// error leaves it where it is, but that AtCut and Selected may have become Hidden, and Hidden,
// under other budgets or where the client refuses the cut, Selected.
class Session::Impl {
 public:
  using TakeBatches = std::function<Status(std::vector<UpdateBatch>)>;

  Impl(std::shared_ptr<const Surface> surface, const SessionOptions& options);
  ~Impl();

  Result<BaseMesh> Base() const;
  Result<SessionUpdate> Update(const Query& query, bool rounds, const TakeBatches& take);
  void RetryFailed();
  TriangleFacts FactsOf(TriangleKey key) const;
  TriangleCorners CornersOf(TriangleKey key) const;
  const ClusterIndex& index() const { return surface_->index(); }
  const Bits& BitsOf(UnitId cluster) const;
  uint64_t applied_count() const;

 private:
  // The client has the moving cut.
  struct AtCut {
    std::unique_ptr<MovingCut> cut;
  };
  // The client has what it had, and a moving cut is on its way behind that, to take its place, or
  // to be shown as far as it fits a budget.
  struct Hidden {
    Selected shown;
    std::unique_ptr<MovingCut> cut;
    bool was_shown;              // the client has had what the cut was
    std::optional<Query> query;  // with a budget: that it is on its way to, over several calls
  };

  const LoadedUnit& UnitOf(TriangleKey key) const;
  Status TakeRoot() const;
  Status Move(MovingCut& cut, UnitReader& reader, const Query& query, bool rounds,
              const TakeBatches& take, SessionUpdate* update);
  Status MoveHidden(UnitReader& reader, const Query& query, const TakeBatches& take,
                    SessionUpdate* update);
  Status MoveWithin(UnitReader& reader, const Query& query, const TakeBatches& take,
                    SessionUpdate* update);
  Status Select(UnitReader& reader, const Query& query, const TakeBatches& take,
                SessionUpdate* update);
  Hidden& Hide();
  void DropHidden();  // of Hidden: only what the client has is left
  Result<Selected> Show(const CutState& cut, UnitReader& reader, const TakeBatches& take,
                        SessionUpdate* update) const;
  Status Follow(MovingCut& cut, const TakeBatches& take, SessionUpdate* update) const;
  void FillStatsOf(const MovingCut& cut, ExtractStats* stats) const;
  void FillStatsOnTheWay(const Selected& shown, ExtractStats* stats) const;
  const Selected& selected() const;  // unless AtCut

  const std::shared_ptr<const Surface> surface_;
  std::unique_ptr<UnitReader> available_;  // not null: it waits for nothing
  std::variant<AtCut, Selected, Hidden> state_;
  std::optional<BudgetCut> within_;  // where the last budget of triangles was
};

Session::Impl::Impl(std::shared_ptr<const Surface> surface, const SessionOptions& options)
    : surface_(std::move(surface)),
      state_(AtCut{std::make_unique<MovingCut>(*surface_->source())}) {
  if (!options.available_only) return;
  available_ =
      std::make_unique<UnitReader>(surface_->cache(), ReaderLimits{nullptr, std::nullopt, true});
  available_->available()->Begin(nullptr, std::nullopt);
}

Session::Impl::~Impl() {
  // Nothing that is on its way is wanted any more.
  if (available_ == nullptr) return;
  static_cast<void>(TryAllocate([&] { available_->available()->Ask({}, true); }));
}

Result<BaseMesh> Session::Impl::Base() const {
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

Status Session::Impl::TakeRoot() const {
  AvailableUnits& units = *available_->available();
  available_->available()->Begin(nullptr, std::nullopt);
  const Status status = units.TakeRoot();
  const std::span<const UnitId> missing = units.missing().list();
  if (!missing.empty()) {
    units.Ask(std::vector<UnitId>(missing.begin(), missing.end()), false);
  }
  return status;
}

void Session::Impl::RetryFailed() {
  if (available_ != nullptr) available_->available()->ForgetFailures();
}

// That creates a triangle of the client's mesh; so it is in memory.
const LoadedUnit& Session::Impl::UnitOf(TriangleKey key) const {
  MTDB_CHECK(available_ != nullptr, "only a session that does not wait knows of its triangles");
  const auto id = static_cast<UnitId>(key >> 32);
  const LoadedUnit* const unit =
      id < index().unit_count() ? available_->available()->Find(id) : nullptr;
  MTDB_CHECK(unit != nullptr && static_cast<uint32_t>(key) < unit->cluster.slots(),
             "no such triangle");
  return *unit;
}

TriangleFacts Session::Impl::FactsOf(TriangleKey key) const {
  const LoadedUnit& unit = UnitOf(key);
  const AvailableUnits& units = *available_->available();
  const UnitId id = unit.id;
  const auto slot = static_cast<uint32_t>(key);
  const ClusterIndex& index = surface_->index();
  const ObjectRecord& record = surface_->record();
  const auto facts = [&](uint8_t code, bool exact) {
    return TriangleFacts{BoundOf(record.grid, code, record.rounding_error), exact, id};
  };
  const uint32_t remover = unit.removers()[slot];
  if (remover == kDrain) return facts(0, true);
  if (!RemovedByChild(remover)) return facts(unit.cluster.error_codes[remover], true);
  const UnitId child_id = unit.children()[ChildOrdinal(remover)];
  const LoadedUnit* const child = units.Find(child_id);
  const uint32_t in_slot = child == nullptr ? kNone32 : child->FindInSlot({id, slot});
  if (in_slot == kNone32) {
    return facts(index.Has(child_id) ? index.unit(child_id).error_code_max : 255, false);
  }
  return facts(child->cluster.error_codes[child->removers()[in_slot]], true);
}

TriangleCorners Session::Impl::CornersOf(TriangleKey key) const {
  MTDB_CHECK(surface_->record().texture.has_value(), "the object has no texture");
  const LoadedUnit& unit = UnitOf(key);
  const auto slot = static_cast<uint32_t>(key);
  const uint32_t external = unit.cluster.external_vertices();
  TriangleCorners found;
  found.corners = unit.cluster.texture(slot);
  const std::array<uint32_t, 3> locals = unit.corners(slot, unit.creator(slot));
  for (size_t i = 0; i < 3; ++i) {
    found.vertices[i] = locals[i] < external
                            ? unit.vertex(locals[i])
                            : index().first_vertex(unit.id) + (locals[i] - external);
  }
  return found;
}

Result<SessionUpdate> Session::Impl::Update(const Query& query, bool rounds,
                                            const TakeBatches& take) {
  const Stopwatch watch;
  const bool waits = available_ == nullptr;
  const bool budget =
      query.max_triangles || query.max_bytes || (waits && query.max_milliseconds.has_value());
  SessionUpdate result;
  ExtractStats& stats = result.stats;
  AtCut* const at_cut = std::get_if<AtCut>(&state_);
  std::optional<UnitReader> waiting;
  if (waits) {
    waiting.emplace(surface_->cache(), ReaderLimits{query.control, query.max_bytes});
  } else {
    MTDB_RETURN_IF_ERROR(CheckLimits(surface_->record(), query));
    if (Hidden* const hidden = std::get_if<Hidden>(&state_); hidden && !budget) {
      hidden->query.reset();
    }
    if (at_cut && !budget) available_->available()->Hold({});
    available_->available()->Begin(query.control, DeadlineOf(query));
  }
  // The control is the caller's, and jobs go on after the call.
  struct Over {
    AvailableUnits* units;
    ~Over() {
      if (units != nullptr) units->End();
    }
  } const over{waits ? nullptr : available_->available()};
  UnitReader& reader = waits ? *waiting : *available_;
  if (!budget && at_cut) {
    MTDB_RETURN_IF_ERROR(Move(*at_cut->cut, reader, query, rounds, take, &result));
  } else if (!budget) {
    MTDB_RETURN_IF_ERROR(MoveHidden(reader, query, take, &result));
  } else if (!waits || (!query.max_bytes && !query.max_milliseconds)) {
    MTDB_RETURN_IF_ERROR(MoveWithin(reader, query, take, &result));
  } else {
    MTDB_RETURN_IF_ERROR(Select(reader, query, take, &result));
  }
  stats.vertices = index().root_vertices() + applied_count();
  stats.nodes_applied = applied_count();
  stats.clusters_total = index().cluster_count();
  reader.FillStats(&stats);
  stats.seconds.select = std::max(0.0, watch.Seconds() - stats.seconds.load);
  return result;
}

Status Session::Impl::Move(MovingCut& cut, UnitReader& reader, const Query& query, bool rounds,
                           const TakeBatches& take, SessionUpdate* update) {
  MTDB_RETURN_IF_ERROR(
      cut.Move(reader, query, rounds ? kRoundNodes : 0, [&] { return Follow(cut, take, update); }));
  FillStatsOf(cut, &update->stats);
  return Status::Ok();
}

Status Session::Impl::MoveHidden(UnitReader& reader, const Query& query, const TakeBatches& take,
                                 SessionUpdate* update) {
  Hidden& hidden = Hide();
  MovingCut& cut = *hidden.cut;
  MTDB_RETURN_IF_ERROR(cut.Move(reader, query, 0, [] { return Status::Ok(); }));
  if (cut.unfinished() && cut.counts().triangles < hidden.shown.triangles) {
    update->stats.missing = cut.missing();
    FillStatsOnTheWay(hidden.shown, &update->stats);
    return Status::Ok();
  }
  Changes changes(*surface_);
  for (UnitId c = 0; c < hidden.shown.applied.size(); ++c) {
    changes.AddUnit(c, hidden.shown.applied[c], cut.applied(c));
  }
  const Status sent = changes.Send(OneByOne(reader), Releasing(reader, take), update);
  if (!sent.ok()) {
    // It may be far larger than what the client has or wants.
    if (available_ == nullptr) DropHidden();
    return sent;
  }
  state_ = AtCut{std::move(hidden.cut)};
  if (available_ != nullptr) available_->available()->Hold({});
  FillStatsOf(cut, &update->stats);
  return Status::Ok();
}

void Session::Impl::FillStatsOf(const MovingCut& cut, ExtractStats* stats) const {
  FillStats(surface_->record(), cut.counts(), cut.active(), stats);
  stats->missing = cut.missing();
  stats->nodes_forced = cut.counts().forced;
  stats->clusters_used = cut.counts().clusters_used;
  stats->nodes_visited = cut.evaluated();
  if (!stats->missing.empty()) stats->limit = QueryLimit::kMissing;
  const bool out_of_time = available_ != nullptr && available_->available()->out_of_time();
  if (cut.unfinished() || out_of_time) stats->limit = QueryLimit::kTime;
}

// The round of a moving cut.
Status Session::Impl::Follow(MovingCut& cut, const TakeBatches& take, SessionUpdate* update) const {
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
  return changes.Send(get, release_and_take, update);
}

// The client sees where the cut ends, and not the cuts on the way, which may be too large. A query
// that a session did not come to the end of, which does not wait, is ended before a later one
// begins: one that a later query ends would never end where each call has another one.
Status Session::Impl::MoveWithin(UnitReader& reader, const Query& query, const TakeBatches& take,
                                 SessionUpdate* update) {
  if (!within_) within_.emplace(*surface_->source());
  Hidden& hidden = Hide();
  MovingCut& cut = *hidden.cut;
  std::optional<Query>& goal = hidden.query;
  const uint64_t shown_triangles = hidden.shown.triangles;
  for (;;) {
    const bool goes_on = goal.has_value();
    if (!goes_on) goal = query;
    goal->control = query.control;
    const Status moved = within_->Move(reader, *goal, goes_on, &cut);
    goal->control = nullptr;
    if (!moved.ok()) goal.reset();
    MTDB_RETURN_IF_ERROR(moved);
    hidden.was_shown |= within_->done() || cut.counts().triangles >= shown_triangles;
    if (within_->fits() && hidden.was_shown) {
      Result<Selected> shown = Show(cut.state(), reader, take, update);
      if (!shown.ok()) goal.reset();
      MTDB_ASSIGN_OR_RETURN(hidden.shown, std::move(shown));
    }
    ExtractStats& stats = update->stats;
    stats.missing = cut.missing();
    const bool answers = available_ == nullptr || (within_->done() && cut.Answers(query) &&
                                                   goal->max_triangles == query.max_triangles);
    if (answers || within_->done()) goal.reset();
    if (answers) {
      FillStats(surface_->record(), cut.counts(), cut.active(), &stats);
      stats.clusters_used = hidden.shown.clusters_used;
      if (within_->ended_by_budget()) stats.limit = QueryLimit::kTriangles;
      if (!stats.missing.empty()) stats.limit = QueryLimit::kMissing;
      stats.nodes_visited = within_->evaluated();
      stats.nodes_forced = cut.counts().forced;
      return Status::Ok();
    }
    if (goal || available_->available()->time_is_over()) {
      FillStatsOnTheWay(hidden.shown, &stats);
      return Status::Ok();
    }
    available_->available()->Begin(query.control, DeadlineOf(query));
  }
}

// The cut moves on behind what the client has.
Session::Impl::Hidden& Session::Impl::Hide() {
  if (AtCut* const at = std::get_if<AtCut>(&state_)) {
    Selected shown(at->cut->state(), at->cut->counts().LargestCode());
    if (available_ != nullptr) available_->available()->Hold(UnitsOf(index(), shown));
    state_ = Hidden{std::move(shown), std::move(at->cut), true, std::nullopt};
  } else if (Selected* const selected = std::get_if<Selected>(&state_)) {
    auto fresh = std::make_unique<MovingCut>(*surface_->source());
    state_ = Hidden{std::move(*selected), std::move(fresh), false, std::nullopt};
  }
  return *std::get_if<Hidden>(&state_);
}

void Session::Impl::DropHidden() {
  // Not from a part of the state into the state, which would be gone by then.
  Selected shown = std::move(std::get_if<Hidden>(&state_)->shown);
  state_ = std::move(shown);
}

// Under other budgets the cut is not the least one of any query, and cannot move on.
Status Session::Impl::Select(UnitReader& reader, const Query& query, const TakeBatches& take,
                             SessionUpdate* update) {
  within_.reset();
  if (std::holds_alternative<Hidden>(state_)) DropHidden();
  const ObjectRecord& record = surface_->record();
  CutState cut(*surface_->source(), false);
  Search search(*surface_->source(), reader, query, record.rounding_error, &cut);
  MTDB_ASSIGN_OR_RETURN(const Search::Outcome outcome, search.Run());
  // What the updates need was in the search's reach, or is what the client holds: no budget.
  UnitReader updates(surface_->cache(), {query.control, std::nullopt});
  MTDB_ASSIGN_OR_RETURN(state_, Show(cut, updates, take, update));
  FillStats(record, cut.counts(), outcome.active, &update->stats);
  update->stats.clusters_used = selected().clusters_used;
  update->stats.limit = outcome.limit;
  update->stats.nodes_visited = outcome.nodes_visited;
  update->stats.nodes_forced = outcome.nodes_forced;
  return Status::Ok();
}

// Has the client take this cut; returns what it has then.
Result<Selected> Session::Impl::Show(const CutState& cut, UnitReader& reader,
                                     const TakeBatches& take, SessionUpdate* update) const {
  Selected now(cut, LargestCodeLeft(cut));
  Changes changes(*surface_);
  for (UnitId c = 0; c < now.applied.size(); ++c) changes.AddUnit(c, BitsOf(c), now.applied[c]);
  std::vector<UnitId> used;
  if (available_ != nullptr) used = UnitsOf(index(), now);
  MTDB_RETURN_IF_ERROR(changes.Send(OneByOne(reader), Releasing(reader, take), update));
  if (available_ != nullptr) available_->available()->Hold(std::move(used));
  return now;
}

// Of the whole mesh that the client has: what it is told of is another query's.
void Session::Impl::FillStatsOnTheWay(const Selected& shown, ExtractStats* stats) const {
  CutState::Counts counts;
  counts.triangles = shown.triangles;
  FillStats(surface_->record(), counts, {true, shown.triangles, shown.largest_code, {}}, stats);
  stats->clusters_used = shown.clusters_used;
  stats->limit = QueryLimit::kTime;
}

const Selected& Session::Impl::selected() const {
  const Hidden* const hidden = std::get_if<Hidden>(&state_);
  return hidden != nullptr ? hidden->shown : *std::get_if<Selected>(&state_);
}

const Bits& Session::Impl::BitsOf(UnitId cluster) const {
  const AtCut* const at = std::get_if<AtCut>(&state_);
  return at != nullptr ? at->cut->applied(cluster) : selected().applied[cluster];
}

uint64_t Session::Impl::applied_count() const {
  const AtCut* const at = std::get_if<AtCut>(&state_);
  return at != nullptr ? at->cut->counts().applied : selected().nodes;
}

// ---- the public part ----

Session::Session(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Session::~Session() = default;

Result<std::unique_ptr<Session>> Session::Open(std::shared_ptr<const Surface> surface,
                                               const SessionOptions& options) {
  MTDB_CHECK(surface != nullptr, "a session needs a surface");
  return CatchOutOfMemory([&]() -> Result<std::unique_ptr<Session>> {
    auto impl = std::make_unique<Impl>(std::move(surface), options);
    return std::unique_ptr<Session>(new Session(std::move(impl)));
  });
}

Result<BaseMesh> Session::Base() const {
  return CatchOutOfMemory([&] { return impl_->Base(); });
}

Result<SessionUpdate> Session::Update(const Query& query, std::vector<UpdateBatch>* batches) {
  batches->clear();
  return CatchOutOfMemory([&] {
    return impl_->Update(query, false, [&](std::vector<UpdateBatch> round) {
      *batches = std::move(round);
      return Status::Ok();
    });
  });
}

Result<SessionUpdate> Session::Update(const Query& query, const BatchSink& sink) {
  return CatchOutOfMemory([&] {
    return impl_->Update(query, true,
                         [&](const std::vector<UpdateBatch>& round) { return sink(round); });
  });
}

void Session::RetryFailed() { impl_->RetryFailed(); }
TriangleFacts Session::FactsOf(TriangleKey key) const { return impl_->FactsOf(key); }
TriangleCorners Session::CornersOf(TriangleKey key) const { return impl_->CornersOf(key); }

bool Session::applied(UnitId cluster, NodeIndex node) const {
  const ClusterIndex& index = impl_->index();
  MTDB_CHECK(
      cluster < index.cluster_count() && (!index.Has(cluster) || node < index.unit(cluster).nodes),
      "no such node");
  const Bits& bits = impl_->BitsOf(cluster);
  return !bits.empty() && bits.Test(node);
}
uint64_t Session::applied_count() const { return impl_->applied_count(); }

}  // namespace mtdb
