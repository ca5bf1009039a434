// CutState: which nodes are applied and which triangles are present, cluster by cluster.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "query/cluster_cache.h"
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
  Bits active;   // per own slot: present, examined and found within e(t) of the region

  // While searching.
  Bits wanted;  // per node: removes an active invalid triangle, and is not applied yet
  uint32_t first_wanted = kNone32;  // no wanted node precedes it; kNone32: there is none
  Bits planned;                     // per node: in the closure that is about to be applied
  Bits exact;  // per own slot: examined with e(t) itself, not its cluster's largest
  LoadedUnitPtr pin;

  // When clipped: what is emitted.
  Bits kept;  // per own slot
  Bits used;  // per node
};

struct CutState {
  std::vector<uint32_t> state_of;  // per unit: its place in `states`, or kNone32
  std::vector<std::unique_ptr<UnitState>> states;
  uint64_t triangles = 0;
  uint64_t nodes_applied = 0;
  uint64_t nodes_forced = 0;
  std::array<uint64_t, 256> active_by_code{};  // present active triangles by their error code

  UnitState& state(uint32_t s) { return *states[s]; }
  const UnitState& state(uint32_t s) const { return *states[s]; }

  uint64_t active_triangles() const {
    uint64_t n = 0;
    for (const uint64_t count : active_by_code) n += count;
    return n;
  }
  // The largest code with an active triangle.
  uint8_t largest_code() const {
    int code = 255;
    while (code > 0 && active_by_code[static_cast<size_t>(code)] == 0) --code;
    return static_cast<uint8_t>(code);
  }
};

}  // namespace mtdb
