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
#include "query/moving/unit_deadlines.h"

namespace mtdb::internal {

// A node of an object, in the order of units and nodes.
using NodeKey = uint64_t;
inline NodeKey KeyOf(UnitId unit, NodeIndex node) { return NodeKey{unit} << 32 | node; }
inline UnitId UnitOf(NodeKey key) { return static_cast<UnitId>(key >> 32); }
inline NodeIndex NodeOf(NodeKey key) { return static_cast<NodeIndex>(key); }

struct MovingUnit final : CutUnit {
  UnitDeadlines deadlines;
  Bits recheck;                              // Strength: per node: may be strong, or weak, now
  Bits suspended;                            // NodeRemoval: per node
  std::vector<NodeIndex> new_suspended;      // NodeRemoval: whose neighbours are still to come
  std::vector<NodeIndex> undecided;          // Insertion: nodes to be looked at
  std::vector<uint32_t> undecided_children;  // Insertion: ordinals

  // Known, but waits to be evaluated: its deadline has passed.
  bool Waits(NodeIndex node) const { return deadlines.node(node).passed() && !refusing.Test(node); }
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
