// CutState: which nodes are applied and which triangles are present, cluster by cluster.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "query/cut.h"
#include "query/internal/bits.h"
#include "query/loaded_unit.h"

namespace mtdb {

// The part of a cut that lies in one cluster or root piece. "Own slot" s is the unit's slot
// first_own_slot + s: in-triangles are counted where they are created.
struct UnitState {
  UnitId unit = 0;
  uint32_t first_own_slot = 0;
  uint32_t applied_count = 0;
  Bits applied;  // per node
  Bits present;  // per own slot: in the mesh of the cut
  Bits active;   // per own slot: present and within e(t) of the region; see CutState::all_active

  // While searching.
  Bits wanted;  // per node: removes an active invalid triangle, and is not applied yet
  uint32_t first_wanted = kNone32;  // no wanted node precedes it; kNone32: there is none
  Bits planned;                     // per node: in the closure that is about to be applied
  const LoadedUnit* pin = nullptr;  // while the reader holds it

  // When clipped: what is emitted.
  Bits kept;  // per own slot
  Bits used;  // per node
};

struct CutState {
  std::vector<uint32_t> state_of;  // per unit: its place in `states`, or kNone32
  std::vector<std::unique_ptr<UnitState>> states;
  uint64_t triangles = 0;
  uint64_t nodes_visited = 0;
  uint64_t nodes_applied = 0;
  uint64_t nodes_forced = 0;
  uint64_t active_triangles = 0;
  QueryLimit limit = QueryLimit::kThreshold;
  bool all_active = false;   // UnitState::active is not filled
  uint8_t largest_code = 0;  // of the errors of active triangles
  Shortfall shortfall;

  UnitState& state(uint32_t s) { return *states[s]; }
  const UnitState& state(uint32_t s) const { return *states[s]; }
};

}  // namespace mtdb
