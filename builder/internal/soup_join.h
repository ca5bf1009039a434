// JoinSoup, JoinEqualPositions: number points, such as the corners of a triangle soup, by exact
// position, out of core.
#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "builder/internal/spool.h"
#include "store/base/status.h"

namespace mtdb::internal {

// `soup` holds corners, three a triangle, each of 3 float32, or of 3 float64 when `doubles`. Equal
// positions (-0 equals +0) become one vertex; vertices are numbered in the order of first sight and
// appended to `vertices` (as they are there). `receive` gets each triangle in its order. Returns
// the number of vertices.
//
// The same for points that carry `row_bytes` bytes each behind their position; the first of equal
// points is the one that is appended. `receive` gets each point's number.
Result<uint64_t> JoinEqualPositions(const Spool& points, bool doubles, size_t row_bytes,
                                    const SpoolSpace* space, size_t memory_bytes, Spool* vertices,
                                    const std::function<Status(uint32_t)>& receive);

// Positions are spread over parts by their hash, so that a part fits in memory; every stream is
// written and read front to back.
Result<uint64_t> JoinSoup(const Spool& soup, bool doubles, const SpoolSpace* space,
                          size_t memory_bytes, Spool* vertices,
                          const std::function<Status(const std::array<uint32_t, 3>&)>& receive);

}  // namespace mtdb::internal
