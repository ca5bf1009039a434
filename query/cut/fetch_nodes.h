// SPDX-License-Identifier: Apache-2.0
// ForEachFetched: works through nodes of a unit without waiting for the memory at each of them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "query/cache/loaded_unit.h"

namespace mtdb::internal {

enum class Fetch : uint8_t {
  kShapes,  // holes, and where their corners are
  kStars,   // holes, and what removes the stars
};

// Calls f(node) for each. What is known of the nodes' holes lies in five places of the unit, each
// found by the one before, and seldom in a processor's cache; so it is asked of the memory for some
// nodes at once.
template <typename F>
void ForEachFetched(const LoadedUnit& unit, std::span<const NodeIndex> nodes, Fetch what, F&& f) {
  const bool stars = what == Fetch::kStars;
  constexpr size_t kAtOnce = 32;
  const CompactCluster& c = unit.cluster;
  while (!nodes.empty()) {
    const std::span<const NodeIndex> some = nodes.first(std::min(kAtOnce, nodes.size()));
    nodes = nodes.subspan(some.size());
    for (const NodeIndex n : some) {
      __builtin_prefetch(&c.error_codes[n]);
      if (!stars) __builtin_prefetch(&c.ring_begin[n]);
      __builtin_prefetch(&c.hole_begin[n]);
      if (stars) __builtin_prefetch(&c.star_begin[n]);
    }
    for (const NodeIndex n : some) {
      if (!stars) __builtin_prefetch(c.ring_vertices.data() + c.ring_begin[n]);
      __builtin_prefetch(c.hole_slots.data() + c.hole_begin[n]);
      if (stars) __builtin_prefetch(c.removers.codes().data() + c.star_begin[n]);
    }
    for (const NodeIndex n : some) {
      if (!stars) {
        for (const uint32_t local : c.ring(n)) c.positions.Prefetch(local);
      }
      for (const uint32_t slot : c.hole(n)) {
        if (slot < unit.first_own_slot()) {
          __builtin_prefetch(&unit.origins[slot]);
        } else {
          const uint32_t own = slot - unit.first_own_slot();
          __builtin_prefetch(&unit.creators[own / LoadedUnit::kCreatorStep]);
        }
      }
    }
    for (const NodeIndex n : some) f(n);
  }
}

}  // namespace mtdb::internal
