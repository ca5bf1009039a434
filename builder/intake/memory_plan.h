// SPDX-License-Identifier: Apache-2.0
// MemoryPlan: how a build divides its memory, given what a vertex carries.
#pragma once

#include <cstddef>
#include <cstdint>

#include "builder/build_options.h"
#include "store/base/attributes.h"
#include "store/base/status.h"

namespace mtdb::internal {

struct MemoryPlan {
  unsigned threads = 1;      // at work on tiles at a time
  size_t ahead = 1;          // tiles on their way at a time, those at work included
  uint64_t spool_bytes = 0;  // for spools, sorters and the join's tables
};

// Divides options.memory_bytes, with at most `threads` threads. Attributes cost: a tile's rows are
// there up to three times, the encoder logs some entries for each value. Errors: kBudgetExceeded,
// saying what is needed, when not even one tile at a time fits; kUnsupported when a vertex carries
// more than any cluster could hold.
Result<MemoryPlan> PlanMemory(const BuildOptions& options, unsigned threads,
                              const AttributeLayout& attributes, bool textured = false);

// The most that the temporary files of a build will take, for a mesh of so many triangles; 0 when
// all of it fits in `spool_bytes`.
uint64_t TemporaryBytes(const BuildOptions& options, uint64_t triangles, size_t row_bytes,
                        uint64_t spool_bytes);

}  // namespace mtdb::internal
