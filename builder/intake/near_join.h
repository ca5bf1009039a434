// SPDX-License-Identifier: Apache-2.0
// NearJoin: finds vertices that lie near each other, out of core.
#pragma once

#include <cstdint>
#include <functional>

#include "builder/disk/spool.h"
#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Vertices, one behind the other in a finished spool: each begins with its position.
struct NearJoinInput {
  const Spool* vertices = nullptr;
  size_t vertex_bytes = 0;
  std::function<Vec3d(const std::byte*)> position;
  double tolerance = 0;  // > 0; model units
};

struct NearJoinTotals {
  uint64_t vertices = 0;    // that are left
  double displacement = 0;  // the farthest that a vertex was moved
};

// Vertices that a chain of distances of at most the tolerance connects become one: the first of
// them, where it is. `left` gets the vertices that stay, as they are there; `numbers`, for each
// vertex, the uint32 number of the one that it became. Neither is finished.
//
// Space is cut into blocks, and each part of the blocks, with what lies near their borders, is
// searched in memory. The vertices that have near ones must fit the memory: kBudgetExceeded
// otherwise. kInvalidArgument when the tolerance is far above the distances of neighbours, or too
// small for the coordinates.
Result<NearJoinTotals> JoinNear(const NearJoinInput& input, const SpoolSpace* space,
                                size_t memory_bytes, Spool* left, Spool* numbers);

}  // namespace mtdb::internal
