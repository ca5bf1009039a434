#include "query/internal/search.h"

#include <algorithm>
#include <string>

namespace mtdb {

// Why the order of work does not matter: activity and validity belong to a triangle, not to the
// cut, and a node that removes an active invalid triangle of the current mesh is in every valid
// cut. So whatever is applied must be, and what remains when nothing is left to apply is the least
// valid cut.

namespace {

// A search holds on to this share of the cache's budget between steps.
constexpr size_t kPinShare = 8;

}  // namespace

Search::Search(const ClusterSource& source, ClusterCache& cache, const Query& query,
               LoadStats& stats)
    : source_(source),
      index_(source.index()),
      grid_(source.record().grid),
      cache_(cache),
      query_(query),
      stats_(stats),
      whole_(query.region == nullptr || query.region->whole()),
      constant_(query.threshold == nullptr ? std::optional<double>(-1.0)
                                           : query.threshold->constant()),
      trivial_(whole_ && constant_.has_value()) {
  for (int code = 0; code < 256; ++code) {
    errors_[static_cast<size_t>(code)] = grid_.Error(static_cast<uint8_t>(code));
  }
  cut_.state_of.assign(UnitCount(index_), kNone32);
  pending_ = Bits(index_.cluster_count());
  looked_into_ = Bits(index_.cluster_count());
}

Status Search::Run() {
  MTDB_RETURN_IF_ERROR(ExamineRoot());
  MTDB_RETURN_IF_ERROR(query_.max_triangles ? RunByError() : RunByClusters());
  ReleasePins(0);
  for (const auto& state : cut_.states) {
    state->wanted = Bits();
    state->planned = Bits();
    state->exact = Bits();
  }
  return Status::Ok();
}

Status Search::ExamineRoot() {
  for (uint32_t r = 0; r < index_.root_piece_count(); ++r) {
    const UnitId unit = index_.cluster_count() + r;
    MTDB_ASSIGN_OR_RETURN(const uint32_t s, StateOf(unit));
    UnitState& state = cut_.state(s);
    MTDB_ASSIGN_OR_RETURN(const LoadedUnit* loaded, Pin(state));
    const auto triangles = static_cast<uint32_t>(loaded->piece.triangles.size());
    state.present.SetRange(0, triangles);
    cut_.triangles += triangles;
    if (MayBeActive(RootPieceId(r))) {
      for (uint32_t slot = 0; slot < triangles; ++slot) ExamineOutSlot(*loaded, state, slot, 0);
    }
    ReleasePins(cache_.budget_bytes() / kPinShare);
  }
  return Status::Ok();
}

bool Search::MayBeActive(RootPieceId piece) const {
  if (whole_) return true;
  uint8_t largest = 0;
  for (const ClusterId child : index_.children(piece)) {
    largest = std::max(largest, index_.cluster(child).error_code_max);
  }
  const Box3i& bounds = index_.root_piece(piece).bounds;
  const Box3d box{grid_.Position(bounds.min), grid_.Position(bounds.max)};
  return query_.region->BoxWithin(box, errors_[largest]);
}

Status Search::RunByClusters() {
  while (!pending_clusters_.empty()) {
    const UnitId unit = pending_clusters_.top();
    pending_clusters_.pop();
    MTDB_RETURN_IF_ERROR(LookInto(unit));
    MTDB_RETURN_IF_ERROR(ApplyTargets());
    ReleasePins(cache_.budget_bytes() / kPinShare);
  }
  return Status::Ok();
}

Status Search::RunByError() {
  while (!queue_.empty()) {
    const Entry entry = queue_.top();
    queue_.pop();
    ReleasePins(cache_.budget_bytes() / kPinShare);
    if (entry.look) {
      MTDB_RETURN_IF_ERROR(LookInto(entry.unit));
      continue;
    }
    const uint32_t s = cut_.state_of[entry.unit];
    if (cut_.state(s).applied.Test(entry.node)) continue;
    MTDB_RETURN_IF_ERROR(PlanClosure({s, entry.node}));
    uint64_t added = 0;
    for (const Target& t : plan_) {
      added += cut_.state(t.state).pin->cluster.boundary(t.node) ? 1 : 2;
    }
    if (cut_.triangles + added > *query_.max_triangles) {
      DropPlan();
      break;
    }
    MTDB_RETURN_IF_ERROR(ApplyPlan());
  }
  return Status::Ok();
}

Status Search::LookInto(UnitId unit) {
  MTDB_ASSIGN_OR_RETURN(const uint32_t s, StateOf(unit));
  MTDB_ASSIGN_OR_RETURN(const LoadedUnit* loaded, Pin(cut_.state(s)));
  pending_.Clear(unit);
  if (!looked_into_.Test(unit)) {
    looked_into_.Set(unit);
    for (uint32_t slot = 0; slot < loaded->cluster.in_triangles(); ++slot) {
      ExamineInSlot(*loaded, s, slot);
    }
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

void Search::ExamineInSlot(const LoadedUnit& unit, uint32_t state, uint32_t slot) {
  const Cluster& cluster = unit.cluster;
  const SlotOrigin& origin = unit.origins[slot];
  const uint32_t p = cut_.state_of[unit.parents[origin.parent]];
  if (p == kNone32) return;
  UnitState& parent = cut_.state(p);
  const uint32_t own = origin.slot - parent.first_own_slot;
  if (!parent.present.Test(own) || parent.exact.Test(own)) return;
  if (parent.active.Test(own)) {
    --cut_.active_by_code[index_.cluster(ClusterId(unit.id)).error_code_max];
    parent.active.Clear(own);
  }
  parent.exact.Set(own);
  const NodeIndex node = cluster.removers[slot];
  const uint8_t code = cluster.error_codes[node];
  const Triangle3d t = Corners(unit, slot, 0);
  if (!Active(t, errors_[code])) return;
  parent.active.Set(own);
  ++cut_.active_by_code[code];
  if (!Valid(t, errors_[code])) Want(state, node, code);
}

// Coarsest unit first, and within a unit in stored order, in which parents precede children: most
// nodes find their parents applied.
Status Search::ApplyTargets() {
  while (!wanting_.empty()) {
    const uint32_t s = wanting_.top().second;
    UnitState& state = cut_.state(s);
    const uint32_t node =
        state.first_wanted == kNone32 ? kNone32 : state.wanted.FirstFrom(state.first_wanted);
    state.first_wanted = node;
    if (node == kNone32) {
      wanting_.pop();
      continue;
    }
    state.wanted.Clear(node);
    if (state.applied.Test(node)) continue;
    MTDB_RETURN_IF_ERROR(PlanClosure({s, node}));
    MTDB_RETURN_IF_ERROR(ApplyPlan());
  }
  return Status::Ok();
}

Status Search::PlanClosure(Target target) {
  plan_.clear();
  closure_.assign(1, target);
  while (!closure_.empty()) {
    const Target t = closure_.back();
    UnitState& state = cut_.state(t.state);
    if (state.applied.Test(t.node) || state.planned.Test(t.node)) {
      closure_.pop_back();
      continue;
    }
    const LoadedUnit* loaded = state.pin.get();
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
    const bool target = &t == &plan_.back();
    MTDB_RETURN_IF_ERROR(ApplyNode(t, target || HasReason(*cut_.state(t.state).pin, t.node)));
  }
  for (const Target& t : plan_) ExamineStar(t);
  return Status::Ok();
}

Status Search::ApplyNode(Target target, bool wanted) {
  UnitState& state = cut_.state(target.state);
  const LoadedUnit& unit = *state.pin;
  const Cluster& cluster = unit.cluster;
  const uint8_t code = cluster.error_codes[target.node];
  const uint8_t largest = index_.cluster(ClusterId(unit.id)).error_code_max;
  for (const uint32_t slot : cluster.hole(target.node)) {
    UnitState* creator = &state;
    uint32_t own = slot - unit.first_own_slot();
    if (slot < unit.first_own_slot()) {
      const SlotOrigin& origin = unit.origins[slot];
      creator = &cut_.state(cut_.state_of[unit.parents[origin.parent]]);
      own = origin.slot - creator->first_own_slot;
    }
    if (!creator->present.Test(own)) return Inconsistent(unit.id, "a hole is not in the mesh");
    creator->present.Clear(own);
    if (creator->active.Test(own)) {
      --cut_.active_by_code[creator->exact.Test(own) ? code : largest];
      creator->active.Clear(own);
    }
  }
  const uint32_t begin = cluster.star_begin[target.node] - unit.first_own_slot();
  const uint32_t end = cluster.star_begin[target.node + 1] - unit.first_own_slot();
  state.present.SetRange(begin, end);
  state.applied.Set(target.node);
  state.planned.Clear(target.node);
  ++state.applied_count;
  ++cut_.nodes_applied;
  if (!wanted) ++cut_.nodes_forced;
  cut_.triangles += end - begin;
  cut_.triangles -= cluster.hole(target.node).size();
  return Status::Ok();
}

void Search::ExamineStar(Target target) {
  UnitState& state = cut_.state(target.state);
  const LoadedUnit& unit = *state.pin;
  const Cluster& cluster = unit.cluster;
  for (uint32_t slot = cluster.star_begin[target.node]; slot < cluster.star_begin[target.node + 1];
       ++slot) {
    const uint32_t own = slot - unit.first_own_slot();
    if (!state.present.Test(own)) continue;
    const uint32_t remover = cluster.removers[slot];
    if (!RemovedByNode(remover)) {
      ExamineOutSlot(unit, state, slot, target.node);
      continue;
    }
    state.exact.Set(own);
    const uint8_t code = cluster.error_codes[remover];
    const Triangle3d t = Corners(unit, slot, target.node);
    if (!Active(t, errors_[code])) continue;
    state.active.Set(own);
    ++cut_.active_by_code[code];
    if (!Valid(t, errors_[code])) Want(target.state, remover, code);
  }
}

void Search::ExamineOutSlot(const LoadedUnit& unit, UnitState& state, uint32_t slot,
                            NodeIndex creator) {
  const uint32_t own = slot - unit.first_own_slot();
  const uint32_t remover = unit.removers()[slot];
  if (remover == kDrain) {
    state.exact.Set(own);
    if (!Active(Corners(unit, slot, creator), 0)) return;
    state.active.Set(own);
    ++cut_.active_by_code[0];
    return;
  }
  const ClusterId child = unit.children()[ChildOrdinal(remover)];
  const bool by_error = query_.max_triangles.has_value();
  const bool pending = pending_.Test(child.value);
  if (pending && !by_error) {  // the child will examine it
    NoteLateArc(child, unit.id, slot);
    return;
  }
  const uint8_t largest = index_.cluster(child).error_code_max;
  const Triangle3d t = Corners(unit, slot, creator);
  if (!Active(t, errors_[largest])) return;
  const bool valid = Valid(t, errors_[largest]);
  // The budgeted search may stop before it looks into the child: count the triangle now.
  if (valid || by_error) {
    state.active.Set(own);
    ++cut_.active_by_code[largest];
  }
  if (valid) return;
  NoteLateArc(child, unit.id, slot);
  if (pending) return;
  pending_.Set(child.value);
  if (by_error) {
    queue_.push({largest, true, child.value, 0});
  } else {
    pending_clusters_.push(child.value);
  }
}

// The first look at a cluster passes all its in-triangles; later ones only those noted since.
void Search::NoteLateArc(ClusterId child, UnitId parent, uint32_t slot) {
  if (looked_into_.Test(child.value)) late_arcs_[child.value].push_back({parent, slot});
}

void Search::Want(uint32_t state, NodeIndex node, uint8_t code) {
  if (query_.max_triangles) {
    queue_.push({code, false, cut_.state(state).unit, node});
  } else {
    UnitState& of = cut_.state(state);
    of.wanted.Set(node);
    if (of.first_wanted == kNone32) wanting_.emplace(of.unit, state);
    of.first_wanted = std::min(of.first_wanted, node);
  }
}

// True when the node removes an active invalid triangle.
bool Search::HasReason(const LoadedUnit& unit, NodeIndex node) const {
  const double error = errors_[unit.cluster.error_codes[node]];
  for (const uint32_t slot : unit.cluster.hole(node)) {
    const bool own = slot >= unit.first_own_slot() && !trivial_;
    const NodeIndex creator = own ? unit.creator(slot) : 0;
    const Triangle3d t = Corners(unit, slot, creator);
    if (Active(t, error) && !Valid(t, error)) return true;
  }
  return false;
}

Triangle3d Search::Corners(const LoadedUnit& unit, uint32_t slot, NodeIndex creator) const {
  if (trivial_) return {};
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
  state->active = Bits(loaded->own_slots());
  state->exact = Bits(loaded->own_slots());
  cut_.states.push_back(std::move(state));
  cut_.state_of[unit] = s;
  pinned_states_.push_back(s);
  return s;
}

Result<const LoadedUnit*> Search::Pin(UnitState& state) {
  if (state.pin == nullptr) {
    MTDB_ASSIGN_OR_RETURN(state.pin, cache_.Get(state.unit, &stats_));
    pinned_bytes_ += state.pin->memory_bytes();
    if (const uint32_t s = cut_.state_of[state.unit]; s != kNone32) pinned_states_.push_back(s);
  }
  return state.pin.get();
}

// Between steps only: within one, units are used by pointer.
void Search::ReleasePins(size_t limit_bytes) {
  if (pinned_bytes_ <= limit_bytes) return;
  for (const uint32_t s : pinned_states_) cut_.state(s).pin.reset();
  pinned_states_.clear();
  pinned_bytes_ = 0;
  cache_.Trim();
}

Status Search::Inconsistent(UnitId unit, const char* what) const {
  return Corrupt(UnitName(source_.record(), unit) + ": " + what + "; rebuild the object");
}

}  // namespace mtdb
