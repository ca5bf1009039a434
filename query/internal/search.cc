#include "query/internal/search.h"

#include <algorithm>
#include <chrono>
#include <string>

namespace mtdb {
namespace {

constexpr uint32_t kLongStar = 16;  // triangles; nearly all stars have less

}  // namespace

// Why the order of work does not matter: activity and validity belong to a triangle, not to the
// cut, and a node that removes an active invalid triangle of the current mesh is in every valid
// cut. So whatever is applied must be, and what remains when nothing is left to apply is the least
// valid cut.

Search::Search(const ClusterSource& source, UnitReader& reader, const Query& query, double rounding)
    : source_(source),
      index_(source.index()),
      grid_(source.record().grid),
      reader_(reader),
      query_(query),
      rounding_(rounding),
      threshold_(Attainable(query.threshold, rounding)),
      whole_(query.region == nullptr || query.region->whole()),
      by_error_(query.max_triangles || query.max_bytes || query.max_milliseconds),
      constant_(threshold_->constant()),
      trivial_(whole_ && constant_.has_value()),
      bounds_(BoundsByCode(grid_, rounding)) {
  for (int code = 0; code < 256; ++code) {
    if (constant_ && bounds_[static_cast<size_t>(code)] <= *constant_) valid_code_ = code;
  }
  cut_.state_of.assign(index_.unit_count(), kNone32);
  pending_ = Bits(index_.unit_count());
  looked_into_ = Bits(index_.unit_count());
  prefetched_ = Bits(index_.unit_count());
}

Status Search::Run() {
  WorkMeter meter([this] { return reader_.Check(); });
  meter_ = &meter;
  const Status status = Find();
  meter_ = nullptr;
  return status;
}

Status Search::Find() {
  const auto start = std::chrono::steady_clock::now();
  MTDB_RETURN_IF_ERROR(ExamineRoot());
  if (query_.max_milliseconds) {
    const std::chrono::duration<double, std::milli> budget(
        std::clamp(*query_.max_milliseconds, 0.0, 1e12));
    reader_.SetDeadline(start + std::chrono::duration_cast<std::chrono::nanoseconds>(budget));
  }
  MTDB_RETURN_IF_ERROR(by_error_ ? RunByError() : RunByClusters());
  reader_.SetDeadline(std::nullopt);
  meter_->Resume();
  MTDB_RETURN_IF_ERROR(Survey());
  ReleasePins();
  for (const auto& state : cut_.states) {
    state->wanted = Bits();
    state->planned = Bits();
  }
  return Status::Ok();
}

template <typename Step>
Status Search::Take(Step&& step) {
  MTDB_RETURN_IF_ERROR(reader_.Check());
  Status status = step();
  if (!status.ok() && reader_.crowded()) {
    DropPlan();
    ReleasePins();
    MTDB_RETURN_IF_ERROR(reader_.WaitForRoom());
    status = step();
  }
  if (status.ok()) status = meter_->status();
  if (!status.ok()) DropPlan();
  if (reader_.ShouldRelease()) ReleasePins();
  if (query_.control != nullptr) {
    query_.control->nodes_applied_.store(cut_.nodes_applied, std::memory_order_relaxed);
  }
  return status;
}

Status Search::ExamineRoot() {
  for (UnitId unit = index_.cluster_count(); unit < index_.unit_count(); ++unit) {
    MTDB_RETURN_IF_ERROR(Take([&] { return ExamineRootPiece(unit); }));
  }
  return Status::Ok();
}

Status Search::ExamineRootPiece(UnitId unit) {
  MTDB_ASSIGN_OR_RETURN(const uint32_t s, StateOf(unit));
  UnitState& state = cut_.state(s);
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* loaded, Pin(state));
  const uint32_t triangles = loaded->cluster.listed();
  state.present.SetRange(0, triangles);
  cut_.triangles += triangles;
  ExamineOutSlots(*loaded, state);
  return Status::Ok();
}

uint8_t Search::LargestCode(const LoadedUnit& unit) const {
  uint8_t largest = index_.unit(unit.id).error_code_max;
  for (const UnitId child : unit.children()) {
    largest = std::max(largest, index_.unit(child).error_code_max);
  }
  return largest;
}

Search::Outlook Search::LookAhead(const Box3i& bounds, uint8_t largest) const {
  Outlook outlook;
  const Box3d box{grid_.Position(bounds.min), grid_.Position(bounds.max)};
  const double error = bounds_[largest];
  meter_->Spend(1);
  outlook.all_active = whole_ || query_.region->BoxCovers(box, 0);
  outlook.none_active = !outlook.all_active && !query_.region->BoxWithin(box, error);
  outlook.all_valid = constant_ && largest <= valid_code_;
  return outlook;
}

Status Search::RunByClusters() {
  while (!pending_clusters_.empty()) {
    PrefetchPending();
    const UnitId unit = *pending_clusters_.begin();
    MTDB_RETURN_IF_ERROR(Take([&] { return LookInto(unit); }));
    MTDB_RETURN_IF_ERROR(Take([&] { return ApplyTargets(); }));
  }
  return Status::Ok();
}

// Every pending cluster will be looked into.
void Search::PrefetchPending() {
  ahead_.clear();
  size_t window = reader_.prefetch_units();
  for (auto it = pending_clusters_.begin(); it != pending_clusters_.end() && window > 0; ++it) {
    --window;
    if (prefetched_.Test(*it)) continue;
    prefetched_.Set(*it);
    if (it != pending_clusters_.begin()) ahead_.push_back(*it);
  }
  if (!ahead_.empty()) reader_.Prefetch(ahead_);
}

Status Search::RunByError() {
  QueryLimit& limit = cut_.limit;
  while (!queue_.empty() && limit == QueryLimit::kThreshold) {
    const ErrorTask task = queue_.Pop();
    const Status status = Take([&] {
      if (!task.look) return Refine({cut_.state_of[task.unit], task.node}, &limit);
      if (query_.max_bytes && reader_.BytesToRead(task.unit) > reader_.bytes_left()) {
        limit = QueryLimit::kBytes;
        return Status::Ok();
      }
      return LookInto(task.unit);
    });
    if (reader_.out_of_bytes()) {
      limit = QueryLimit::kBytes;
    } else if (reader_.out_of_time()) {
      limit = QueryLimit::kTime;
    } else {
      MTDB_RETURN_IF_ERROR(status);
    }
  }
  return Status::Ok();
}

Status Search::Refine(Target target, QueryLimit* limit) {
  if (cut_.state(target.state).applied.Test(target.node)) return Status::Ok();
  MTDB_RETURN_IF_ERROR(PlanClosure(target));
  uint64_t added = 0;
  for (const Target& t : plan_) {
    added += cut_.state(t.state).pin->cluster.boundary(t.node) ? 1 : 2;
  }
  if (query_.max_triangles && cut_.triangles + added > *query_.max_triangles) {
    *limit = QueryLimit::kTriangles;
    DropPlan();
    return Status::Ok();
  }
  return ApplyPlan();
}

Status Search::LookInto(UnitId unit) {
  MTDB_ASSIGN_OR_RETURN(const uint32_t s, StateOf(unit));
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* loaded, Pin(cut_.state(s)));
  pending_.Clear(unit);
  pending_clusters_.erase(unit);
  if (!looked_into_.Test(unit)) {
    looked_into_.Set(unit);
    cut_.nodes_visited += loaded->nodes();
    if (by_error_) {
      for (uint32_t slot = 0; slot < loaded->cluster.in_triangles(); ++slot) {
        ExamineInSlot(*loaded, s, slot);
      }
      return Status::Ok();
    }
    ApplyInOrder(*loaded, s);
    ExamineOutSlots(*loaded, cut_.state(s));
    return Status::Ok();
  }
  const auto late = late_arcs_.find(unit);
  if (late == late_arcs_.end()) return Status::Ok();
  const std::vector<Arc> arcs = std::move(late->second);
  late_arcs_.erase(late);
  for (const Arc& arc : arcs) {
    const uint32_t slot = loaded->FindInSlot(arc.parent, arc.slot);
    if (slot == kNone32) return Inconsistent(unit, "an arc to it does not arrive");
    ExamineInSlot(*loaded, s, slot);
  }
  return Status::Ok();
}

void Search::FindParents(const LoadedUnit& unit) {
  parents_.clear();
  for (const UnitId p : unit.parents) {
    const uint32_t s = cut_.state_of[p];
    if (s == kNone32) {
      parents_.emplace_back();
    } else {
      UnitState& parent = cut_.state(s);
      parents_.push_back({&parent, &parent.present, parent.first_own_slot});
    }
  }
}

// Presence is a byte for each slot meanwhile, so that a node is a few plain loads and stores.
void Search::ApplyInOrder(const LoadedUnit& unit, uint32_t s) {
  UnitState& state = cut_.state(s);
  const Cluster& cluster = unit.cluster;
  const Outlook outlook =
      LookAhead(index_.unit(unit.id).bounds, index_.unit(unit.id).error_code_max);
  if (outlook.none_active || outlook.all_valid) return;
  const bool by_code = constant_ && outlook.all_active;
  FindParents(unit);
  TakeBytes(unit, state);
  // First a list, since codes are hard to predict.
  candidates_.resize(cluster.nodes());
  size_t count = 0;
  const int valid_code = valid_code_;
  for (NodeIndex node = 0; node < cluster.nodes(); ++node) {
    candidates_[count] = node;
    count += cluster.error_codes[node] > valid_code ? 1 : 0;
  }
  for (size_t i = 0; i < count; ++i) {
    const NodeIndex node = candidates_[i];
    const std::span<const uint32_t> hole = cluster.hole(node);
    uint32_t present = 0;
    for (const uint32_t slot : hole) present += bytes_[slot];
    if (present == 0 || (!by_code && !IsWanted(unit, node))) continue;
    if (present == hole.size()) {
      ApplyInBytes(unit, state, node, true);
    } else {
      ForceInBytes(unit, s, node);
    }
  }
  ReturnBytes(unit, state);
}

// The bounds of the hole, whose corners are the ring, decide most cases.
bool Search::IsWanted(const LoadedUnit& unit, NodeIndex node) const {
  const Cluster& cluster = unit.cluster;
  const double error = bounds_[cluster.error_codes[node]];
  if (!whole_) {
    Box3i bounds;
    for (const uint32_t local : cluster.ring(node)) bounds.Add(cluster.in.positions[local]);
    const Box3d box{grid_.Position(bounds.min), grid_.Position(bounds.max)};
    if (!meter_->Spend(1) || !query_.region->BoxWithin(box, error)) return false;
    if (constant_ && query_.region->BoxCovers(box, 0)) return true;
  }
  for (const uint32_t slot : cluster.hole(node)) {
    if (bytes_[slot] == 0) continue;
    const NodeIndex creator = slot < unit.first_own_slot() ? 0 : unit.creator(slot);
    if (Refused(Corners(unit, slot, creator), error)) return true;
  }
  return false;
}

void Search::TakeBytes(const LoadedUnit& unit, const UnitState& state) {
  const uint32_t first_own = unit.first_own_slot();
  bytes_.assign(size_t{first_own} + state.present.size() + kLongStar, 0);
  for (uint32_t slot = 0; slot < first_own; ++slot) bytes_[slot] = Present(unit, state, slot);
  if (state.applied_count > 0) {
    state.present.ForEach([&](uint32_t own) { bytes_[first_own + own] = 1; });
  }
}

void Search::ReturnBytes(const LoadedUnit& unit, UnitState& state) {
  const uint32_t first_own = unit.first_own_slot();
  for (uint32_t slot = 0; slot < first_own; ++slot) {
    const SlotOrigin& origin = unit.origins[slot];
    const Parent& parent = parents_[origin.parent];
    if (parent.present != nullptr) {
      parent.present->Keep(origin.slot - parent.first_own_slot, bytes_[slot] != 0);
    }
  }
  state.present.Pack(bytes_.data() + first_own);
}

// The hole is present.
void Search::ApplyInBytes(const LoadedUnit& unit, UnitState& state, NodeIndex node, bool wanted) {
  const Cluster& cluster = unit.cluster;
  const std::span<const uint32_t> hole = cluster.hole(node);
  for (const uint32_t slot : hole) bytes_[slot] = 0;
  const uint32_t begin = cluster.star_begin[node];
  const uint32_t size = cluster.star_begin[node + 1] - begin;
  uint8_t* const star = bytes_.data() + begin;
  if (size <= kLongStar) {
    // Of no varying length, which would be hard to predict.
    for (uint32_t j = 0; j < kLongStar; ++j) star[j] |= j < size ? 1 : 0;
  } else {
    std::fill_n(star, size, uint8_t{1});
  }
  state.applied.Set(node);
  ++state.applied_count;
  ++cut_.nodes_applied;
  cut_.nodes_forced += wanted ? 0 : 1;
  cut_.triangles += size;
  cut_.triangles -= hole.size();
}

// Applies a node and its missing ancestors as far as these are in the cluster. What needs more, and
// what the ancestors' stars make wanted, goes the general way later.
void Search::ForceInBytes(const LoadedUnit& unit, uint32_t s, NodeIndex target) {
  UnitState& state = cut_.state(s);
  const Cluster& cluster = unit.cluster;
  missing_.assign(1, target);
  while (!missing_.empty()) {
    const NodeIndex node = missing_.back();
    const size_t depth = missing_.size();
    if (!state.applied.Test(node)) {
      for (const uint32_t slot : cluster.hole(node)) {
        if (bytes_[slot] != 0) continue;
        if (slot < unit.first_own_slot() || state.applied.Test(unit.creator(slot))) {
          return Want(s, target, cluster.error_codes[target]);
        }
        missing_.push_back(unit.creator(slot));
      }
      if (missing_.size() > depth) continue;
      ApplyInBytes(unit, state, node, node == target || HasReason(unit, node));
      for (uint32_t slot = cluster.star_begin[node]; slot < cluster.star_begin[node + 1]; ++slot) {
        const uint32_t remover = cluster.removers[slot];
        // Later nodes have their turn.
        if (remover >= target) continue;
        const uint8_t code = cluster.error_codes[remover];
        if (code > valid_code_ && Refused(Corners(unit, slot, node), bounds_[code])) {
          Want(s, remover, code);
        }
      }
    }
    missing_.pop_back();
  }
}

void Search::ExamineOutSlots(const LoadedUnit& unit, UnitState& state) {
  const std::vector<UnitId>& children = unit.children();
  settled_.assign(children.size(), false);
  size_t open = children.size();
  const auto settle = [&](size_t ordinal) {
    settled_[ordinal] = true;
    --open;
  };
  for (size_t i = 0; i < children.size(); ++i) {
    const UnitEntry& child = index_.unit(children[i]);
    const Outlook outlook = LookAhead(child.bounds, child.error_code_max);
    if (outlook.none_active || outlook.all_valid) settle(i);
  }
  const std::vector<uint32_t>& removers = unit.removers();
  for (uint32_t own = state.present.FirstFrom(0); own != kNone32 && open > 0;
       own = state.present.FirstFrom(own + 1)) {
    const uint32_t slot = own + unit.first_own_slot();
    const uint32_t remover = removers[slot];
    if (!RemovedByChild(remover) || settled_[ChildOrdinal(remover)]) continue;
    const UnitId child = children[ChildOrdinal(remover)];
    ExamineOutSlot(unit, state, slot, trivial_ ? 0 : unit.creator(slot));
    // Pending for the first time: it will see all its in-triangles itself.
    if (!by_error_ && pending_.Test(child) && !looked_into_.Test(child)) {
      settle(ChildOrdinal(remover));
    }
  }
}

void Search::ExamineInSlot(const LoadedUnit& unit, uint32_t s, uint32_t slot) {
  FindParents(unit);
  if (!Present(unit, cut_.state(s), slot)) return;
  const NodeIndex node = unit.cluster.removers[slot];
  const uint8_t code = unit.cluster.error_codes[node];
  if (code > valid_code_ && Refused(Corners(unit, slot, 0), bounds_[code])) Want(s, node, code);
}

// Coarsest unit first, and within a unit in stored order, in which parents precede children: most
// nodes find their parents applied.
Status Search::ApplyTargets() {
  while (!wanting_.empty() && meter_->Spend(1)) {
    const uint32_t s = wanting_.top().second;
    UnitState& state = cut_.state(s);
    const uint32_t node =
        state.first_wanted == kNone32 ? kNone32 : state.wanted.FirstFrom(state.first_wanted);
    state.first_wanted = node;
    if (node == kNone32) {
      wanting_.pop();
      continue;
    }
    if (!state.applied.Test(node)) {
      MTDB_RETURN_IF_ERROR(PlanClosure({s, node}));
      MTDB_RETURN_IF_ERROR(ApplyPlan());
    }
    state.wanted.Clear(node);
  }
  return Status::Ok();
}

Status Search::PlanClosure(Target target) {
  plan_.clear();
  closure_.assign(1, target);
  while (!closure_.empty()) {
    if (!meter_->Spend(1)) return meter_->status();
    const Target t = closure_.back();
    UnitState& state = cut_.state(t.state);
    if (state.applied.Test(t.node) || state.planned.Test(t.node)) {
      closure_.pop_back();
      continue;
    }
    const LoadedUnit* loaded = state.pin;
    if (loaded == nullptr) {
      MTDB_ASSIGN_OR_RETURN(loaded, Pin(state));
    }
    bool ready = true;
    MTDB_RETURN_IF_ERROR(PushMissingParents(*loaded, t.state, t.node, &ready));
    if (!ready) continue;
    state.planned.Set(t.node);
    plan_.push_back(t);
    closure_.pop_back();
  }
  return Status::Ok();
}

Status Search::PushMissingParents(const LoadedUnit& unit, uint32_t state, NodeIndex node,
                                  bool* ready) {
  for (const uint32_t slot : unit.cluster.hole(node)) {
    uint32_t s = state;
    uint32_t own = slot - unit.first_own_slot();
    NodeIndex creator = 0;
    if (slot < unit.first_own_slot()) {
      const SlotOrigin& origin = unit.origins[slot];
      s = cut_.state_of[unit.parents[origin.parent]];
      if (s == kNone32) {
        MTDB_ASSIGN_OR_RETURN(s, StateOf(unit.parents[origin.parent]));
      }
      own = origin.slot - cut_.state(s).first_own_slot;
      if (cut_.state(s).present.Test(own)) continue;
      creator = origin.creator;
    } else {
      if (cut_.state(s).present.Test(own)) continue;
      creator = unit.creator(slot);
    }
    const UnitState& from = cut_.state(s);
    if (creator == kNone32 || from.applied.Test(creator)) {
      return Inconsistent(unit.id, "two nodes remove one triangle");
    }
    if (from.planned.Test(creator)) continue;
    closure_.push_back({s, creator});
    *ready = false;
  }
  return Status::Ok();
}

void Search::DropPlan() {
  for (const Target& t : plan_) cut_.state(t.state).planned.Clear(t.node);
  plan_.clear();
}

Status Search::ApplyPlan() {
  for (const Target& t : plan_) {
    UnitState& state = cut_.state(t.state);
    const LoadedUnit& unit = *state.pin;
    const bool target = &t == &plan_.back();
    FindParents(unit);
    for (const uint32_t slot : unit.cluster.hole(t.node)) {
      if (!Present(unit, state, slot)) return Inconsistent(unit.id, "a hole is not in the mesh");
    }
    ApplyNode(unit, state, t.node, target || HasReason(unit, t.node));
    state.planned.Clear(t.node);
  }
  for (const Target& t : plan_) ExamineStar(t);
  return Status::Ok();
}

// The hole is present, and parents_ are the unit's.
void Search::ApplyNode(const LoadedUnit& unit, UnitState& state, NodeIndex node, bool wanted) {
  const Cluster& cluster = unit.cluster;
  const uint32_t first_own = unit.first_own_slot();
  const std::span<const uint32_t> hole = cluster.hole(node);
  for (const uint32_t slot : hole) {
    if (slot >= first_own) {
      state.present.Clear(slot - first_own);
      continue;
    }
    const SlotOrigin& origin = unit.origins[slot];
    const Parent& parent = parents_[origin.parent];
    parent.present->Clear(origin.slot - parent.first_own_slot);
  }
  const uint32_t begin = cluster.star_begin[node] - first_own;
  const uint32_t end = cluster.star_begin[node + 1] - first_own;
  state.present.SetRange(begin, end);
  state.applied.Set(node);
  ++state.applied_count;
  ++cut_.nodes_applied;
  cut_.nodes_forced += wanted ? 0 : 1;
  cut_.triangles += end - begin;
  cut_.triangles -= hole.size();
}

void Search::ExamineStar(Target target) {
  UnitState& state = cut_.state(target.state);
  const LoadedUnit& unit = *state.pin;
  const Cluster& cluster = unit.cluster;
  for (uint32_t slot = cluster.star_begin[target.node]; slot < cluster.star_begin[target.node + 1];
       ++slot) {
    if (!state.present.Test(slot - unit.first_own_slot())) continue;
    const uint32_t remover = cluster.removers[slot];
    if (!RemovedByNode(remover)) {
      ExamineOutSlot(unit, state, slot, target.node);
      continue;
    }
    const uint8_t code = cluster.error_codes[remover];
    if (code <= valid_code_) continue;
    if (Refused(Corners(unit, slot, target.node), bounds_[code])) {
      Want(target.state, remover, code);
    }
  }
}

void Search::ExamineOutSlot(const LoadedUnit& unit, UnitState& state, uint32_t slot,
                            NodeIndex creator) {
  const uint32_t remover = unit.removers()[slot];
  if (remover == kDrain) return;
  const UnitId child = unit.children()[ChildOrdinal(remover)];
  const bool pending = pending_.Test(child);
  if (pending && !looked_into_.Test(child)) return;  // the child will examine it
  const uint8_t largest = index_.unit(child).error_code_max;
  if (largest <= valid_code_) return;
  if (!pending && !Refused(Corners(unit, slot, creator), bounds_[largest])) return;
  NoteLateArc(child, state.unit, slot);
  if (pending) return;
  pending_.Set(child);
  if (by_error_) {
    queue_.Push({largest, true, child, 0});
  } else {
    pending_clusters_.insert(child);
  }
}

// The first look at a cluster passes all its in-triangles; later ones only those noted since.
void Search::NoteLateArc(UnitId child, UnitId parent, uint32_t slot) {
  if (looked_into_.Test(child)) late_arcs_[child].push_back({parent, slot});
}

void Search::Want(uint32_t state, NodeIndex node, uint8_t code) {
  UnitState& of = cut_.state(state);
  if (of.wanted.Test(node)) return;
  of.wanted.Set(node);
  if (by_error_) {
    queue_.Push({code, false, of.unit, node});
    return;
  }
  if (of.first_wanted == kNone32) wanting_.emplace(of.unit, state);
  of.first_wanted = std::min(of.first_wanted, node);
}

// True when the node removes an active invalid triangle.
bool Search::HasReason(const LoadedUnit& unit, NodeIndex node) const {
  const double error = bounds_[unit.cluster.error_codes[node]];
  for (const uint32_t slot : unit.cluster.hole(node)) {
    const bool own = slot >= unit.first_own_slot() && !trivial_;
    const NodeIndex creator = own ? unit.creator(slot) : 0;
    const Triangle3d t = Corners(unit, slot, creator);
    if (Refused(t, error)) return true;
  }
  return false;
}

// What was asked for was not given where rounding does not permit it, and after a budget's end.
bool Search::MayFallShort() const {
  if (cut_.limit != QueryLimit::kThreshold) return true;
  return mtdb::MayFallShort(query_.threshold, source_.record().bounds, rounding_);
}

Status Search::Survey() {
  cut_.all_active = whole_;
  surveys_shortfall_ = MayFallShort();
  if (surveys_shortfall_ && trivial_ && cut_.limit == QueryLimit::kThreshold) {
    // All triangles have the same bound.
    cut_.shortfall = {cut_.triangles, rounding_ - *query_.threshold->constant(),
                      source_.record().bounds};
    surveys_shortfall_ = false;
  }
  const bool errors_only = whole_ && !surveys_shortfall_;
  if (errors_only) cut_.active_triangles = cut_.triangles;
  for (const auto& state : cut_.states) {
    // No present triangle is invalid but where a budget ended the search.
    if (errors_only && cut_.largest_code == valid_code_ && !by_error_) break;
    MTDB_RETURN_IF_ERROR(
        Take([&] { return errors_only ? SurveyErrors(*state) : SurveyUnit(*state); }));
  }
  return Status::Ok();
}

Status Search::SurveyErrors(UnitState& state) {
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* unit, Pin(state));
  FindParents(*unit);
  for (NodeIndex node = 0; node < unit->nodes(); ++node) {
    const uint8_t code = unit->cluster.error_codes[node];
    if (code <= cut_.largest_code || state.applied.Test(node)) continue;
    for (const uint32_t slot : unit->cluster.hole(node)) {
      if (Present(*unit, state, slot)) cut_.largest_code = code;
    }
  }
  state.present.ForEach([&](uint32_t own) {
    const uint32_t remover = unit->removers()[own + unit->first_own_slot()];
    if (!RemovedByChild(remover)) return;
    const UnitId child = unit->children()[ChildOrdinal(remover)];
    if (looked_into_.Test(child)) return;
    cut_.largest_code = std::max(cut_.largest_code, index_.unit(child).error_code_max);
  });
  return Status::Ok();
}

Status Search::SurveyUnit(UnitState& state) {
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* unit, Pin(state));
  const uint32_t first_own = unit->first_own_slot();
  if (state.active.empty()) state.active = Bits(unit->own_slots());
  const ThresholdPtr asked = query_.threshold == nullptr ? threshold_ : query_.threshold;
  const Outlook outlook = LookAhead(index_.unit(state.unit).bounds, LargestCode(*unit));
  if (outlook.none_active) return Status::Ok();
  const auto survey = [&](uint32_t slot, NodeIndex creator, uint8_t code, const Outlook& of) {
    if (of.none_active) return false;
    const double bound = bounds_[code];
    if (!of.all_active && !Active(Corners(*unit, slot, creator), bound)) return false;
    ++cut_.active_triangles;
    cut_.largest_code = std::max(cut_.largest_code, code);
    if (surveys_shortfall_ && meter_->Spend(1)) {
      AddShortfall(*asked, Corners(*unit, slot, creator), bound, unit->removers()[slot] != kDrain,
                   &cut_.shortfall);
    }
    return true;
  };
  // A cluster that was looked into knows the errors of its in-triangles.
  if (looked_into_.Test(state.unit)) {
    FindParents(*unit);
    for (uint32_t slot = 0; slot < first_own; ++slot) {
      if (!Present(*unit, state, slot)) continue;
      const uint8_t code = unit->cluster.error_codes[unit->cluster.removers[slot]];
      if (!survey(slot, 0, code, outlook)) continue;
      const SlotOrigin& origin = unit->origins[slot];
      UnitState& parent = *parents_[origin.parent].state;
      if (parent.active.empty()) parent.active = Bits(parent.present.size());
      parent.active.Set(origin.slot - parent.first_own_slot);
    }
  }
  // Nothing for what another cluster surveys.
  const auto code_of = [&](uint32_t slot) -> std::optional<uint8_t> {
    const uint32_t remover = unit->removers()[slot];
    if (RemovedByNode(remover)) return unit->cluster.error_codes[remover];
    if (!RemovedByChild(remover)) return 0;
    const UnitId child = unit->children()[ChildOrdinal(remover)];
    if (looked_into_.Test(child)) return std::nullopt;
    return index_.unit(child).error_code_max;
  };
  const bool all_active = outlook.all_active && !surveys_shortfall_;
  if (all_active) {
    // What nobody removes needs no look.
    cut_.active_triangles += state.active.AddBoth(state.present.words(), unit->drain);
  }
  if (unit->nodes() == 0 || all_active) {
    state.present.ForEach([&](uint32_t own) {
      if (state.active.Test(own)) return;
      const std::optional<uint8_t> code = code_of(own + first_own);
      if (code && survey(own + first_own, 0, *code, outlook)) state.active.Set(own);
    });
    return Status::Ok();
  }
  const Cluster& cluster = unit->cluster;
  state.applied.ForEach([&](NodeIndex node) {
    star_.clear();
    uint8_t largest = 0;
    const uint32_t begin = cluster.star_begin[node] - first_own;
    const uint32_t end = cluster.star_begin[node + 1] - first_own;
    for (uint32_t own = state.present.FirstFrom(begin); own < end;
         own = state.present.FirstFrom(own + 1)) {
      if (const std::optional<uint8_t> code = code_of(own + first_own)) {
        star_.emplace_back(own, *code);
        largest = std::max(largest, *code);
      }
    }
    if (star_.empty()) return;
    Box3i bounds;
    bounds.Add(cluster.position(cluster.external_vertices() + node));
    for (const uint32_t local : cluster.ring(node)) bounds.Add(cluster.position(local));
    const Outlook of_star = LookAhead(bounds, largest);
    for (const auto& [own, code] : star_) {
      if (survey(own + first_own, node, code, of_star)) state.active.Set(own);
    }
  });
  return Status::Ok();
}

Triangle3d Search::Corners(const LoadedUnit& unit, uint32_t slot, NodeIndex creator) const {
  if (trivial_ && !surveys_shortfall_) return {};
  const std::array<uint32_t, 3> corners = unit.corners(slot, creator);
  const std::vector<Vec3i>& positions = unit.positions();
  return {grid_.Position(positions[corners[0]]), grid_.Position(positions[corners[1]]),
          grid_.Position(positions[corners[2]])};
}

Result<uint32_t> Search::StateOf(UnitId unit) {
  if (cut_.state_of[unit] != kNone32) return cut_.state_of[unit];
  const auto s = static_cast<uint32_t>(cut_.states.size());
  auto state = std::make_unique<UnitState>();
  state->unit = unit;
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* loaded, Pin(*state));
  state->first_own_slot = loaded->first_own_slot();
  state->applied = Bits(loaded->nodes());
  state->wanted = Bits(loaded->nodes());
  state->planned = Bits(loaded->nodes());
  state->present = Bits(loaded->own_slots());
  cut_.states.push_back(std::move(state));
  cut_.state_of[unit] = s;
  pinned_states_.push_back(s);
  return s;
}

Result<const LoadedUnit*> Search::Pin(UnitState& state) {
  if (state.pin == nullptr) {
    MTDB_ASSIGN_OR_RETURN(state.pin, reader_.Get(state.unit));
    if (const uint32_t s = cut_.state_of[state.unit]; s != kNone32) pinned_states_.push_back(s);
  }
  return state.pin;
}

// Between steps only: within one, units are used by pointer.
void Search::ReleasePins() {
  for (const uint32_t s : pinned_states_) cut_.state(s).pin = nullptr;
  pinned_states_.clear();
  reader_.Release();
}

Status Search::Inconsistent(UnitId unit, const char* what) const {
  return Corrupt(UnitName(source_.record(), unit) + ": " + what + "; rebuild the object");
}

}  // namespace mtdb
