// MovingCut: the least cut of a query, kept up to date as the query changes.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <set>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "query/internal/bits.h"
#include "query/internal/fetch_nodes.h"
#include "query/internal/promise.h"
#include "query/internal/work_meter.h"
#include "query/query.h"
#include "query/unit_reader.h"
#include "store/base/status.h"
#include "store/cluster_source.h"

namespace mtdb {

// For each unit in use it remembers which triangles are refused (active and invalid) where a node
// could remove them, and by how much the threshold has to change before that can be otherwise: a
// deadline on the sum of the threshold's changes over the unit's box. A new query looks again at
// the nodes whose deadlines have passed. Units that cannot be needed are closed: their parents keep
// a deadline for them. Budgets of a query are not observed. Used by one thread.
class MovingCut {
 public:
  // Called after each round, with the cut that is reached; the changes since the last round are at
  // hand. An error undoes the round.
  using Commit = std::function<Status()>;

  explicit MovingCut(const ClusterSource& source);
  ~MovingCut();

  // Moves to the least cut of the query: in one round, or with round_nodes > 0 in several when many
  // nodes are to be inserted, those of large errors first: a round inserts at least so many nodes,
  // and a quarter of all. Each round ends with a cut. On an error the cut is that of the last
  // round.
  Status Move(UnitReader& reader, const Query& query, uint64_t round_nodes, const Commit& commit);

  // Calls f(unit, before, now) with the applied bits of clusters that this round may have changed.
  // Empty bits stand for none.
  template <typename F>
  void ForEachChange(F&& f) const;
  // Empty when no node is.
  const Bits& applied(UnitId unit) const;
  // During Move: the unit, until the next call.
  Result<const LoadedUnit*> Pin(UnitId unit);
  // During Move: lets go of all units.
  void ReleasePins();

  struct Totals {
    uint64_t triangles = 0;
    uint64_t applied = 0;
    uint64_t forced = 0;         // applied nodes that remove no refused triangle; between moves
    uint64_t clusters_used = 0;  // between moves
    // Of the mesh: triangles by the code of their error; for a child that is not open its largest.
    std::array<uint64_t, 256> by_code{};
  };
  // After a move, with errors as in ExtractStats: triangles within their bound of the region, the
  // largest code of these, and which of them fall short.
  struct Active {
    uint64_t triangles = 0;
    uint8_t largest_code = 0;
    Shortfall shortfall;
  };
  const Active& active() const { return active_; }
  const Totals& totals() const { return totals_; }
  // Units of which something is kept.
  size_t open_units() const { return open_.size(); }
  // Nodes looked at by the last move.
  uint64_t evaluated() const { return evaluated_; }

 private:
  enum class Activity : uint8_t { kNone, kSome, kAll };  // of the triangles in a unit's box
  struct Arc {
    UnitId parent;
    uint32_t slot;
  };
  struct Flags {
    Bits applied;  // per node
    Bits strong;   // per node: applied, and refused triangles alone explain why; see Strengthen
    // Per node: what follows is known of it; all that are applied, and more. False for the others.
    Bits known;
    Bits refusing;  // per node: removes a refused triangle
    Bits refused;   // per place in Cluster::hole_slots: that triangle is refused
    Bits present;   // per own slot: in the mesh of the cut
    uint32_t applied_count = 0;
    uint32_t forced = 0;
  };
  struct Unit : Flags {
    UnitId id = 0;
    uint32_t first_own = 0;
    bool sized = false;   // the flags per slot are there
    bool looked = false;  // all in-triangles have been looked at
    bool fresh = true;    // opened in this round
    bool queued = false;
    bool prefetched = false;
    bool stale = true;  // deadlines mean nothing
    Activity activity = Activity::kNone;
    Box3d box;
    double reach = 0;  // the largest bound of a triangle that it creates or removes
    ErrorRange range;  // of the threshold's Min in the box
    // Bounds of the sum of all changes of Min since the deadlines began.
    double low = 0, high = 0;
    bool fell = true, rose = true;  // in this move
    // Per node: to be looked at again when `low` has fallen to it, or, for those that refuse, when
    // `high` has risen to it. Whole words of nodes.
    std::vector<float> deadlines;
    // Nodes that refuse some of their triangles: both deadlines count.
    struct Mixed {
      NodeIndex node;
      float low, high;
    };
    std::vector<Mixed> mixed;
    std::vector<float> gates;  // per child that is not open: likewise when `low` has fallen
    const LoadedUnit* pin = nullptr;
    std::unique_ptr<Flags> before;  // at the end of the last round, where it differs

    // Work.
    Bits wanted;  // per node
    Bits forced_to;
    Bits dirty;  // per node: may have become strong or weak; then: is suspended
    std::vector<Arc> arrivals;
    std::vector<NodeIndex> todo;
    std::vector<uint32_t> gates_todo;
  };
  using Key = uint64_t;  // of a node
  static Key KeyOf(UnitId unit, NodeIndex node) { return Key{unit} << 32 | node; }

  Unit* Find(UnitId unit) const { return units_[unit].get(); }
  Unit& Open(UnitId unit);
  Result<const LoadedUnit*> Pin(Unit& u);
  void Size(Unit& u, const LoadedUnit& unit) const;
  void Save(Unit& u);
  void Undo();
  void Count(Unit& u);
  Status EndRoundWith(const Commit& commit);
  void Enqueue(Unit& u);
  // The first of the queue, which is not empty, leaves it.
  Unit& TakeQueued();

  Status Step(const Query& query, uint64_t round_nodes, const Commit& commit);
  // 1. What the new query decides otherwise.
  Status Decide(Unit& u);
  void FindExpired(Unit& u, bool all);
  // As deadlines: what is at least, at most the value.
  static float Up(double value);
  static float Down(double value);

  // Known, but waits to be looked at.
  static bool Unjudged(const Unit& u, NodeIndex node) {
    return u.deadlines[node] == std::numeric_limits<float>::infinity() && !u.refusing.Test(node);
  }
  // A judgement for all of a unit's box stands with such a margin: a share of the range of Min.
  static double GoodMargin(const Unit& u) {
    constexpr double kShare = 0.5;
    return kShare * (u.range.high - u.range.low);
  }
  bool Evaluate(Unit& u, const LoadedUnit& unit, NodeIndex node);
  struct Verdict {
    bool some = false, all = false;  // triangles are refused
    double fall = 0, rise = 0;       // of the threshold, that change that
  };
  Verdict Judge(const Unit& u, const LoadedUnit& unit, NodeIndex node);
  Verdict JudgeTriangles(const LoadedUnit& unit, NodeIndex node, bool all_active);
  Triangle3d Corners(const LoadedUnit& unit, uint32_t slot) const;
  Activity ActivityOf(const Box3d& box, double reach) const;
  // 2. What is no longer needed.
  Status Strengthen();
  bool IsStrong(const Unit& u, const LoadedUnit& unit, NodeIndex node) const;
  void Suspend(Unit& u, NodeIndex node);
  Status SuspendAll();
  void SuspendAround(Unit& u, const LoadedUnit& unit, NodeIndex node);
  Status RemoveUnfounded();
  void Remove(Unit& u, const LoadedUnit& unit, NodeIndex node);
  // 3. What is missing.
  Status Refine(uint64_t round_nodes, const Commit& commit);
  bool LowerFloor(int step);
  Status RunQueue();
  Status Advance(Unit& u);
  void LookAt(Unit& u, const LoadedUnit& unit);
  void Touch(Unit& u, const LoadedUnit& unit, NodeIndex node);
  void Want(Unit& u, NodeIndex node, uint8_t code);
  Status Insert(Unit& u, const LoadedUnit& unit, NodeIndex node, bool* waits);
  void Apply(Unit& u, const LoadedUnit& unit, NodeIndex node);
  void PassGates(Unit& u, const LoadedUnit& unit);
  void PassGate(Unit& u, const LoadedUnit& unit, uint32_t slot, uint32_t ordinal);
  double GateMargin(const Unit& u, const LoadedUnit& unit, uint32_t slot, double error) const;
  Status Survey();
  void SurveyUnit(const Unit& u, const LoadedUnit& unit, bool shortfall);
  uint8_t LargestCode(UnitId cluster) const { return index_.unit(cluster).error_code_max; }
  // 4. Closes units that no present triangle can need.
  void CloseIdle();
  bool Close(Unit& u, const LoadedUnit& unit);

  bool Present(const Unit& u, const LoadedUnit& unit, uint32_t slot) const;
  void SetPresent(Unit& u, const LoadedUnit& unit, uint32_t slot, bool present);
  Result<NodeIndex> RemoverOf(const LoadedUnit& unit, const Arc& arc) const;
  Status Inconsistent(UnitId unit, const char* what) const;

  const ClusterSource& source_;
  const ClusterIndex& index_;
  const Grid& grid_;
  const double rounding_;                 // model units
  const std::array<double, 256> bounds_;  // by code
  std::vector<std::unique_ptr<Unit>> units_;
  std::vector<UnitId> open_;
  Totals totals_;
  Active active_;
  uint64_t evaluated_ = 0;
  uint32_t moves_ = 0;
  ThresholdPtr asked_;      // the query's
  ThresholdPtr threshold_;  // the attainable one
  RegionPtr region_;

  // While moving.
  UnitReader* reader_ = nullptr;
  // Once it says that the move is to end, answers are void; what was done with them is undone.
  WorkMeter* meter_ = nullptr;
  Totals totals_before_;
  std::vector<UnitId> pinned_;
  std::vector<UnitId> touched_;  // saved or fresh
  std::set<UnitId, std::greater<>> queue_;
  std::vector<UnitId> ahead_;
  // What has an error of at most this code waits in `later_` (nodes) and `later_gates_` (children).
  int floor_ = -1;
  std::array<std::vector<std::pair<UnitId, uint32_t>>, 256> later_, later_gates_;
  QueryControl* control_ = nullptr;
  uint64_t inserted_ = 0;  // in this round
  uint64_t inserted_in_all_ = 0;
  std::vector<NodeIndex> expired_;
  std::vector<uint32_t> expired_gates_;
  std::vector<NodeIndex> missing_;
  std::vector<NodeIndex> todo_;
  std::vector<bool> refusals_;  // of a node that refuses some of its triangles
  std::vector<bool> gates_open_;
  std::vector<UnitId> idle_;
  std::vector<Key> seeds_;
  std::vector<Key> suspended_;  // all of them; those that stay so are `dirty`
  // Per node of these: its triangles that nodes remove which are not suspended. Not listed: none.
  std::unordered_map<Key, int32_t> holds_;
  std::vector<std::pair<Key, Key>> leads_;  // the first, if founded, makes the second so
};

template <typename F>
void MovingCut::ForEachChange(F&& f) const {
  static const Bits kNone;
  for (const UnitId id : touched_) {
    const Unit& u = *units_[id];
    if (index_.unit(id).nodes > 0)
      f(id, u.before == nullptr ? kNone : u.before->applied, u.applied);
  }
}

}  // namespace mtdb
