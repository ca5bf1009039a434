// SPDX-License-Identifier: Apache-2.0
// LoadIntoMemory: a unit, and what it comes from, from the source or the file.
#pragma once

#include <cstdint>
#include <utility>

#include "query/cache/cache_memory.h"
#include "query/cache/loaders.h"

namespace mtdb::internal {

// What a load does while something is not there that others bring.
enum class Waiting : uint8_t {
  kNever,    // fails with kNotYet
  kAnyhow,   // waits, whatever becomes of its query
  kWatched,  // on the query's own thread: waits, and does jobs meanwhile; ends with the query
  kAlone,    // likewise, while nobody else holds units
};

struct LoadOutcome {
  LoadOutcome(Status what, bool for_room = false) : status(std::move(what)), no_room(for_room) {}
  Status status;  // ok: the unit is ready, and pinned
  bool no_room;   // that is why it failed
};

// With the cache's mutex held; let go of while reading, decoding and waiting.
LoadOutcome LoadIntoMemory(UnitId unit, CacheMemory& memory, Loaders& loaders, CacheUserPtr user,
                           Waiting waiting, MutexLock& lock);

}  // namespace mtdb::internal
