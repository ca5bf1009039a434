// SPDX-License-Identifier: Apache-2.0
// Search: finds the least cut that satisfies a query, from the root down.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "query/cache/unit_reader.h"
#include "query/cut/bits.h"
#include "query/cut/cut_state.h"
#include "query/cut/judge.h"
#include "query/cut/level_queue.h"
#include "query/cut/stored_order_pass.h"
#include "query/cut/survey.h"
#include "query/cut/unit_pins.h"
#include "query/cut/unit_queue.h"
#include "query/fields/work_meter.h"
#include "query/query.h"
#include "store/base/status.h"

namespace mtdb::internal {

// When the time of a query is over that begins now.
std::optional<std::chrono::steady_clock::time_point> DeadlineOf(const Query& query);
// kInvalidArgument for limits that a query that takes what is there cannot have.
Status CheckLimits(const ObjectRecord& record, const Query& query);

// Goes from cluster to cluster, coarsest first, and inside a cluster from node to node in stored
// order. A cluster is loaded only when the index cannot prove that the triangles it removes are
// valid or inactive. With a budget a priority queue takes the place of that order. One use.
class Search {
 public:
  struct Outcome {
    ActiveTriangles active;
    uint64_t nodes_visited = 0;
    uint64_t nodes_forced = 0;
    QueryLimit limit = QueryLimit::kThreshold;
    std::vector<MissingCluster> missing;
  };

  // Makes of the cut, of which no unit is open, that of the query; see Judge for `rounding`.
  Search(const ClusterSource& source, UnitReader& reader, const Query& query, double rounding,
         CutState* cut);

  // Sets CutUnit::active, but for ActiveTriangles::all.
  Result<Outcome> Run();

 private:
  using NodeRef = CutState::NodeRef;

  Status RunFromRoot();
  Status OpenRoot();
  Status RunByClusters();
  // Of a query that takes what is there: says what it lacks, and has that asked for.
  void AskForMissing();
  Status RunByLevel();
  // Takes back what does not fit, with what belongs to its cutoff.
  Status TakeBackLevel();
  void EnterLevel(const LevelTask& task);
  Status RunTask(const LevelTask& task);
  template <typename Step>
  Status RunStep(Step&& step);
  Status Advance(CutUnit& u);
  // Looks at the in-triangles that have come since it was last looked at.
  Status LookAt(CutUnit& u);
  // Inserts the node if that fits the budget of triangles, which ends the search if not.
  Status Insert(NodeRef target);
  // What to do about the present triangles of units and nodes, one by one: their removers may be
  // wanted, or be in clusters that have to be looked at.
  void ExamineOutSlots(const LoadedUnit& unit, CutUnit& u);
  void ExamineStar(NodeRef node);
  void ExamineSlot(const LoadedUnit& unit, CutUnit& u, uint32_t slot, NodeIndex creator);
  void ExamineOutSlot(const LoadedUnit& unit, CutUnit& u, uint32_t slot, NodeIndex creator);
  void Want(CutUnit& u, NodeIndex node, int level);

  const ClusterIndex& index_;
  const Box3d& bounds_;
  const Query& query_;
  CutState& cut_;
  WorkMeter meter_;
  UnitPins pins_;
  Judge judge_;
  StoredOrderPass pass_;
  const bool by_level_;  // there is a budget
  Outcome outcome_;
  UnitQueue queue_;
  Bits pending_;  // per unit: waits to be looked at
  // By level: how far that has come, and what has come since the cutoff was reached.
  struct {
    LevelQueue queue;
    std::vector<int16_t> looks;  // in pixels, per unit: the highest that it waits at
    Cutoff cutoff;
    std::vector<NodeRef> inserted;
    uint64_t forced_before = 0;
  } level_;
  std::vector<NodeRef> inserted_;
  std::vector<bool> decided_;  // per child of the unit at hand
};

}  // namespace mtdb::internal
