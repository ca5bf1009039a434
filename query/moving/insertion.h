// SPDX-License-Identifier: Apache-2.0
// Insertion: brings in what a cut needs. docs/design.md, "Refining".
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "query/moving/decisions.h"
#include "query/moving/moving_units.h"
#include "query/moving/strength.h"
#include "query/query_control.h"

namespace mtdb::internal {

// Selective refinement from the cut that is there, nodes of large errors first. As in Search the
// order does not matter for where it ends. What has a smaller error waits, so that a round can end
// on the way; cuts between rounds hold all their parents.
class Insertion {
 public:
  Insertion(MovingUnits& units, Decisions& decisions, Strength& strength)
      : units_(units), decisions_(decisions), strength_(strength) {}

  // Begins a move: all waits. What the last one has left still does, if the query is the same.
  void Begin(QueryControl* control);
  // What was left is for another query to decide upon: its units become stale.
  void GiveUp();
  // A known node that is refusing; a child that may be needed. They wait.
  void Defer(const MovingUnit& u, NodeIndex node, uint8_t code) {
    nodes_waiting_[code].emplace_back(u.id, node);
  }
  void DeferChild(MovingUnit& u, uint32_t ordinal, UnitId child);
  // Works off the queue and what waits. With round_nodes > 0 calls end_round when so many nodes
  // have come, and a quarter of all. With a reader that waits for nothing it ends after the step
  // during which the time is over, and any that after which the mesh has more than `most`
  // triangles, unless it is the root; what is left to do then waits for the next move.
  Status Run(uint64_t round_nodes, uint64_t most, const std::function<Status()>& end_round);
  // Something is left to do, but for what is missing.
  bool unfinished() const { return unfinished_; }
  // Needs no memory.
  void Clear();
  // Children that may be needed, and whose clusters were missing, wait again if they have come.
  void DeferMissing();
  void ForgetMissing() { missing_.clear(); }

 private:
  using NodeRef = CutState::NodeRef;

  // Takes up what waits, by `step` codes; false when nothing does.
  bool TakeUp(int step);
  bool AnyWaits();
  Status Leave();
  bool TimeIsOver() const;
  bool TooMany() const { return units_.counts().triangles > most_ && units_.counts().applied > 0; }
  Status RunQueue(bool timed);
  Status Advance(MovingUnit& u, const LoadedUnit& unit);
  void LookAt(MovingUnit& u, const LoadedUnit& unit);
  void LookAtChildren(MovingUnit& u, const LoadedUnit& unit);
  Status Insert(MovingUnit& u, const LoadedUnit& unit, NodeIndex node);
  void FollowInsertion(MovingUnit& u, NodeIndex node);
  // A triangle that the node, or a child, removes has become present.
  void ReachNode(MovingUnit& u, NodeIndex node, uint8_t code);
  void ReachChild(MovingUnit& u, const LoadedUnit& unit, uint32_t slot, uint32_t ordinal);
  void Want(MovingUnit& u, NodeIndex node, uint8_t code);

  MovingUnits& units_;
  Decisions& decisions_;
  Strength& strength_;
  QueryControl* control_ = nullptr;
  // What has an error of at most this code waits: nodes, and children of units by their ordinals.
  int waiting_code_ = 255;
  std::array<std::vector<std::pair<UnitId, uint32_t>>, 256> nodes_waiting_, children_waiting_;
  std::vector<std::pair<UnitId, uint32_t>> missing_;  // children: their clusters were not there
  bool unfinished_ = false;
  uint64_t most_ = 0;      // triangles
  uint64_t inserted_ = 0;  // in this round
  uint64_t inserted_before_ = 0;
  std::vector<NodeRef> closure_;
  std::vector<NodeIndex> nodes_;
};

}  // namespace mtdb::internal
