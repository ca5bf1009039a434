// SPDX-License-Identifier: Apache-2.0
// MovingCut: the least cut of a query, kept up to date as the query changes.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "query/cache/unit_reader.h"
#include "query/cut/survey.h"
#include "query/moving/deadlines.h"
#include "query/moving/decisions.h"
#include "query/moving/insertion.h"
#include "query/moving/moving_units.h"
#include "query/moving/removal.h"
#include "query/moving/strength.h"
#include "query/query.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb::internal {

// A new query goes through four hands: Deadlines tell what it may decide otherwise, Strength tells
// why the nodes are there, NodeRemoval takes away those that have no reason, and Insertion brings
// in what is missing. Units that cannot be needed are closed: their parents keep a deadline for
// them. Budgets of a query are not observed. Used by one thread.
class MovingCut {
 public:
  // Called after each round, with the cut that is reached; the changes since the last round are at
  // hand. An error undoes the round.
  using Commit = std::function<Status()>;

  explicit MovingCut(const ClusterSource& source);

  // Moves to the least cut of the query: in one round, or with round_nodes > 0 in several when many
  // nodes are to be inserted, those of large errors first: a round inserts at least so many nodes,
  // and a quarter of all. Each round ends with a cut. On an error the cut is that of the last
  // round.
  Status Move(UnitReader& reader, const Query& query, uint64_t round_nodes, const Commit& commit) {
    return Move(reader, query, {}, round_nodes, commit);
  }
  // Likewise with a cutoff, in one round. It may end on the way when the mesh has more than `most`
  // triangles: it is then unfinished. `first`: of the moves of one call. The last of these is
  // followed by EndMoves: what is missing is asked for, and if `finds_active` what is active is
  // found; `complete`: every active triangle is valid.
  Status MoveTo(UnitReader& reader, const Query& query, const Cutoff& cutoff, uint64_t most,
                bool first);
  Status EndMoves(UnitReader& reader, bool finds_active, bool complete);
  const CutState& state() const { return units_; }
  // Whether the last query was this one, as objects or by value, but for its budgets.
  bool Answers(const Query& query) { return units_.judge().Same(query); }

  // Calls f(unit, before, now) with the applied bits of clusters that this round may have changed.
  // Empty bits stand for none.
  template <typename F>
  void ForEachChange(F&& f) const;
  // Empty when no node is.
  const Bits& applied(UnitId unit) const;
  // During Move, for its Commit: the unit, until the next call.
  Result<const LoadedUnit*> Pin(UnitId unit) { return units_.pins().PinOne(*units_.Find(unit)); }
  // Likewise: lets go of all units.
  void ReleasePins() { units_.pins().Release(); }

  const CutState::Counts& counts() const { return units_.counts(); }
  // After a move.
  const ActiveTriangles& active() const { return active_; }
  // After a move by a reader that waits for nothing: what it lacked, and whether the time was over
  // before all was done. The next move with the same query goes on.
  const std::vector<MissingCluster>& missing() const { return missing_; }
  bool unfinished() const { return insertion_.unfinished(); }
  // Units of which something is kept.
  size_t open_units() const { return units_.open().size(); }
  // Nodes looked at by the last move.
  uint64_t evaluated() const { return decisions_.evaluated(); }

 private:
  struct Goal {
    Cutoff cutoff;
    uint64_t most = ~uint64_t{0};
    bool first = true;
    bool last = true;
  };
  Status Move(UnitReader& reader, const Query& query, const Goal& goal, uint64_t round_nodes,
              const Commit& commit);
  // Runs work that needs units.
  template <typename Work>
  Status RunWith(UnitReader& reader, Work&& work);
  Status Step(const Query& query, const Goal& goal, uint64_t round_nodes, const Commit& commit);
  // What the query decides otherwise: sets refused triangles, tells Strength and Insertion. All
  // units were asked if `anything_moved`.
  Status Decide(const Query& query, const Cutoff& cutoff, bool* anything_moved);
  Status DecideUnit(MovingUnit& u, const Expired& expired, const Deadlines::Moved& moved);
  Status EndRound(const Commit& commit);
  void AskForMissing();
  // Closes units that no present triangle can need.
  void CloseIdle();
  bool MayClose(MovingUnit& u, const LoadedUnit& unit);

  const Box3d bounds_;
  MovingUnits units_;
  Deadlines deadlines_;
  Decisions decisions_;
  Strength strength_;
  NodeRemoval removal_;
  Insertion insertion_;
  ActiveTriangles active_;
  std::vector<MissingCluster> missing_;
  uint32_t moves_ = 0;
  std::vector<NodeKey> weak_;  // nodes that NodeRemoval begins with
  std::vector<UnitId> idle_;   // units that may have become superfluous
};

template <typename F>
void MovingCut::ForEachChange(F&& f) const {
  static const Bits kNone;
  for (const UnitId id : units_.touched()) {
    const CutUnit& u = *units_.Find(id);
    if (!u.applied.empty()) f(id, u.before == nullptr ? kNone : u.before->applied, u.applied);
  }
}

}  // namespace mtdb::internal
