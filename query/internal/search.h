// Search: finds the least cut that satisfies a query, from the root down.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <queue>
#include <set>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "query/internal/cut_state.h"
#include "query/internal/error_queue.h"
#include "query/internal/promise.h"
#include "query/internal/work_meter.h"
#include "query/query.h"
#include "query/unit_reader.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb {

// Goes from cluster to cluster, coarsest first, and inside a cluster from node to node in stored
// order. A cluster is loaded only when the index cannot prove that the triangles it removes are
// valid or inactive. With a budget a priority queue takes the place of that order. One use.
class Search {
 public:
  // What rounding displaces the mesh by, in model units, counts with the threshold.
  Search(const ClusterSource& source, UnitReader& reader, const Query& query, double rounding);

  Status Run();
  CutState TakeState() { return std::move(cut_); }

 private:
  struct Target {
    uint32_t state;
    NodeIndex node;
  };
  struct Arc {
    UnitId parent;
    uint32_t slot;
  };
  // What a unit sees of a parent: its own slots in the mesh. Null: none of them is.
  struct Parent {
    UnitState* state = nullptr;
    Bits* present = nullptr;
    uint32_t first_own_slot = 0;
  };
  // What can be said of all triangles inside of a box whose bounds are at most some bound.
  struct Outlook {
    bool none_active = false;
    bool all_active = false;
    bool all_valid = false;
  };

  Status Find();
  Status ExamineRoot();
  Status ExamineRootPiece(UnitId unit);
  Status RunByClusters();
  Status RunByError();
  // Applies the node if that fits; says what does not.
  Status Refine(Target target, QueryLimit* limit);
  // Examines those in-triangles of a cluster that are present and have not been examined.
  Status LookInto(UnitId unit);
  // Applies the wanted nodes of a cluster in one pass over its nodes: parents precede children, so
  // that most holes are there when their node's turn comes.
  void ApplyInOrder(const LoadedUnit& unit, uint32_t state);
  void TakeBytes(const LoadedUnit& unit, const UnitState& state);
  void ReturnBytes(const LoadedUnit& unit, UnitState& state);
  // By the bytes: removes an active invalid triangle.
  bool IsWanted(const LoadedUnit& unit, NodeIndex node) const;
  void ApplyInBytes(const LoadedUnit& unit, UnitState& state, NodeIndex node, bool wanted);
  void ForceInBytes(const LoadedUnit& unit, uint32_t state, NodeIndex target);
  // Finds the children that have to be looked into.
  void ExamineOutSlots(const LoadedUnit& unit, UnitState& state);
  void ExamineInSlot(const LoadedUnit& unit, uint32_t state, uint32_t slot);
  void NoteLateArc(UnitId child, UnitId parent, uint32_t slot);
  // Applies the wanted nodes, and those that become wanted or necessary on the way.
  Status ApplyTargets();
  // Lists the node's missing ancestors and itself in plan_, in an order that can be applied.
  Status PlanClosure(Target target);
  Status PushMissingParents(const LoadedUnit& unit, uint32_t state, NodeIndex node, bool* ready);
  void DropPlan();
  Status ApplyPlan();
  void ApplyNode(const LoadedUnit& unit, UnitState& state, NodeIndex node, bool wanted);
  void ExamineStar(Target target);
  // An own slot whose remover is not in the same unit.
  void ExamineOutSlot(const LoadedUnit& unit, UnitState& state, uint32_t slot, NodeIndex creator);
  void Want(uint32_t state, NodeIndex node, uint8_t code);
  bool HasReason(const LoadedUnit& unit, NodeIndex node) const;

  // When all is applied: which present triangles are active, the largest of their errors, and
  // which fall short.
  Status Survey();
  bool MayFallShort() const;
  Status SurveyUnit(UnitState& state);
  // All triangles are active: only the largest error is to be found.
  Status SurveyErrors(UnitState& state);

  // Fills parents_.
  void FindParents(const LoadedUnit& unit);
  bool Present(const LoadedUnit& unit, const UnitState& state, uint32_t slot) const {
    if (slot >= unit.first_own_slot()) return state.present.Test(slot - unit.first_own_slot());
    const SlotOrigin& origin = unit.origins[slot];
    const Parent& parent = parents_[origin.parent];
    return parent.present != nullptr && parent.present->Test(origin.slot - parent.first_own_slot);
  }

  Triangle3d Corners(const LoadedUnit& unit, uint32_t slot, NodeIndex creator) const;
  // Questions. When the meter says that the query is to end, whatever they answer is void.
  // Active and invalid.
  bool Refused(const Triangle3d& t, double error) const {
    return Active(t, error) && !Valid(t, error);
  }
  bool Active(const Triangle3d& t, double error) const {
    return whole_ || (meter_->Spend(1) && query_.region->Within(t, error));
  }
  bool Valid(const Triangle3d& t, double error) const {
    if (constant_) return error <= *constant_;
    return !meter_->Spend(1) || error <= threshold_->Min(t, error);
  }
  Outlook LookAhead(const Box3i& bounds, uint8_t largest) const;
  // The largest error code of a triangle that the unit creates or consumes.
  uint8_t LargestCode(const LoadedUnit& unit) const;

  Result<uint32_t> StateOf(UnitId unit);
  Result<const LoadedUnit*> Pin(UnitState& state);
  void ReleasePins();
  // Takes a step that may be taken twice: when it finds no room for what it holds, again alone.
  template <typename Step>
  Status Take(Step&& step);
  void PrefetchPending();
  Status Inconsistent(UnitId unit, const char* what) const;

  const ClusterSource& source_;
  const ClusterIndex& index_;
  const Grid& grid_;
  UnitReader& reader_;
  WorkMeter* meter_ = nullptr;  // while it runs
  const Query& query_;
  const double rounding_;
  const ThresholdPtr threshold_;          // the attainable one
  const bool whole_;                      // no region
  const bool by_error_;                   // there is a budget
  const std::optional<double> constant_;  // the threshold, where it is one number
  const bool trivial_;                    // both: the geometry need not be looked at
  const std::array<double, 256> bounds_;  // by code
  bool surveys_shortfall_ = false;
  int valid_code_ = -1;  // codes up to this one are valid everywhere

  CutState cut_;
  Bits pending_;      // per unit: to be looked into
  Bits looked_into_;  // per unit: once at least
  std::unordered_map<UnitId, std::vector<Arc>> late_arcs_;
  std::set<UnitId, std::greater<>> pending_clusters_;
  Bits prefetched_;  // per unit
  std::vector<UnitId> ahead_;
  ErrorQueue queue_;
  std::priority_queue<std::pair<UnitId, uint32_t>> wanting_;  // units with wanted nodes; states
  std::vector<Target> closure_;
  std::vector<Target> plan_;
  std::vector<Parent> parents_;
  std::vector<bool> settled_;  // per child of the unit at hand
  // Of ApplyInOrder.
  std::vector<uint8_t> bytes_;  // per slot: 1 when present
  std::vector<NodeIndex> candidates_;
  std::vector<NodeIndex> missing_;
  std::vector<std::pair<uint32_t, uint8_t>> star_;  // of SurveyUnit: slots and error codes
  std::vector<uint32_t> pinned_states_;
};

}  // namespace mtdb
