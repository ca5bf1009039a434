// SPDX-License-Identifier: Apache-2.0
// MovingUnits: what a moving cut keeps of its units, and what those who work on it share.
#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "query/cut/cut_state.h"
#include "query/cut/judge.h"
#include "query/cut/unit_pins.h"
#include "query/cut/unit_queue.h"

namespace mtdb::internal {

// A node of an object, in the order of units and nodes.
using NodeKey = uint64_t;
inline NodeKey KeyOf(UnitId unit, NodeIndex node) { return NodeKey{unit} << 32 | node; }
inline UnitId UnitOf(NodeKey key) { return static_cast<UnitId>(key >> 32); }
inline NodeIndex NodeOf(NodeKey key) { return static_cast<NodeIndex>(key); }

// How far a query may move before a decision can be otherwise: by how much the threshold has to
// fall or to rise, or borders of regions to shift.
struct Leeway {
  double fall = std::numeric_limits<double>::infinity();
  double rise = std::numeric_limits<double>::infinity();
  double shift = std::numeric_limits<double>::infinity();
};

// Of Deadlines: when a unit's decisions may be otherwise.
struct UnitDeadlines {
  // Of a node that refuses some of its triangles, and not all: both count.
  struct Mixed {
    NodeIndex node;
    float low, high;
  };
  bool stale = true;  // all have passed
  Activity activity = Activity::kNone;
  Box3d box;
  double reach = 0;  // Judge::Reach
  ErrorRange range;  // of Min in the box, of the threshold that the unit's nodes are judged by
  ErrorRange child_range;  // likewise, by which children are wanted
  double margin = 0;       // of the threshold's borders from the box
  // Bounds of the sum of all changes of Min in the box since the deadlines began, where no border
  // passed; and of how far borders shifted.
  double low = 0, high = 0, shift = 0;
  double shift_before = 0;                        // `shift`, without this move
  bool fell = true, rose = true, shifted = true;  // in this move
  // Per known node, whole words of them: its decision stands until `low` has fallen to this; or,
  // of a node that refuses, until `high` has risen to it. NaN of those in `mixed`.
  std::vector<float> nodes;
  std::vector<Mixed> mixed;
  // Per child that is not open: it is not needed until `low` has fallen to this.
  std::vector<float> children;
  // Likewise: a decision, or what is said of a child, stands until `shift` has grown to this. Empty
  // while no border of the threshold matters, or none at all.
  std::vector<float> node_shifts, child_shifts;
  // Of known nodes of a unit through which the region's border passes, else empty: all triangles of
  // the hole and the star are active until `shift` has grown to this or, negative, inactive; 0: the
  // border is there, and node_shifts tells when the decision may be otherwise. NaN: not asked,
  // since the threshold alone decided.
  std::vector<float> sides;
  // Per node: the hole and the star lie in the cube of so many steps around the node's first
  // vertex; 0: not known.
  std::vector<uint16_t> reaches;
  // Per word of nodes: no deadline of its nodes passes before these.
  struct Soonest {
    float low = -std::numeric_limits<float>::infinity();
    float high = std::numeric_limits<float>::infinity();
    float shift = std::numeric_limits<float>::infinity();
    float side = std::numeric_limits<float>::infinity();
  };
  std::vector<Soonest> soonest;
};

struct MovingUnit final : CutUnit {
  UnitDeadlines deadlines;
  Bits recheck;                              // Strength: per node: may be strong, or weak, now
  Bits suspended;                            // Removal: per node
  std::vector<NodeIndex> new_suspended;      // Removal: those whose neighbours are still to come
  std::vector<NodeIndex> undecided;          // Insertion: nodes to be looked at
  std::vector<uint32_t> undecided_children;  // Insertion: ordinals
};

// The cut, what its query says, and the units at work. One thread.
class MovingUnits final : public CutState {
 public:
  explicit MovingUnits(const ClusterSource& source)
      : CutState(source, true), judge_(source, source.record().rounding_error), queue_(*this) {}

  MovingUnit* Find(UnitId unit) const { return static_cast<MovingUnit*>(CutState::Find(unit)); }
  // A unit that is opened goes to the queue, to be looked at.
  MovingUnit& Open(UnitId unit) override;

  Judge& judge() { return judge_; }
  UnitQueue& queue() { return queue_; }
  // While moving.
  UnitPins& pins() { return *pins_; }
  void SetPins(UnitPins* pins) { pins_ = pins; }
  // The rest of the queue, unit by unit: f(u, unit) gives a Status. Each is a step. It ends when
  // stop() says so after a step.
  template <typename F>
  Status RunQueue(F&& f) {
    return RunQueue(std::forward<F>(f), [] { return false; });
  }
  template <typename F, typename Stop>
  Status RunQueue(F&& f, Stop&& stop) {
    for (bool first = true; !queue_.empty() && (first || !stop()); first = false) {
      auto& u = static_cast<MovingUnit&>(queue_.Take());
      MTDB_RETURN_IF_ERROR(pins_->RunOn(u, [&](const LoadedUnit& unit) { return f(u, unit); }));
    }
    return Status::Ok();
  }
  // Calls f(node) for the removers of the triangles that have come or gone, and forgets these.
  template <typename F>
  Status ForEachArrival(MovingUnit& u, const LoadedUnit& unit, F&& f) {
    std::array<uint32_t, LoadedUnit::kArcsAtOnce> slots;
    for (std::span<const Arc> rest = u.arrivals; !rest.empty();) {
      const std::span<const Arc> some = rest.first(std::min(slots.size(), rest.size()));
      rest = rest.subspan(some.size());
      unit.FindInSlots(some, slots.data());
      for (size_t i = 0; i < some.size(); ++i) {
        if (slots[i] == kNone32) return NotArriving(unit.id);
        f(unit.cluster.removers[slots[i]]);
      }
    }
    u.arrivals.clear();
    return Status::Ok();
  }
  // Undoes the round, and with it all work that was begun. What was learnt in it is forgotten.
  void UndoMove();

 private:
  Judge judge_;
  UnitQueue queue_;
  UnitPins* pins_ = nullptr;
};

}  // namespace mtdb::internal
