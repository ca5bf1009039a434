// SPDX-License-Identifier: Apache-2.0
// JoinSoup, JoinEqualPositions: number points, such as the corners of a triangle soup, by exact
// position, out of core.
#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "builder/disk/spool.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Vertices are numbered in 32 bits while a mesh is built: some 8.5 billion triangles.
constexpr uint64_t kMaxVertices = 0xfffffffeull;
Status TooManyVertices();

// `points` are of 3 float32 each, or of 3 float64 when `doubles`, with `row_bytes` bytes behind
// them. Equal positions (-0 equals +0) become one vertex, the first of them; vertices are numbered
// in the order of first sight and appended to `vertices` as the points are there. `receive` gets
// each point's number, in their order. Returns the number of vertices.
//
// Positions are spread over parts by their hash, so that a part fits in memory; every stream is
// written and read front to back.
Result<uint64_t> JoinEqualPositions(const Spool& points, bool doubles, size_t row_bytes,
                                    const SpoolSpace* space, size_t memory_bytes, Spool* vertices,
                                    const std::function<Status(uint32_t)>& receive);

// Likewise of corners, three a triangle. `receive` gets each triangle.
Result<uint64_t> JoinSoup(const Spool& soup, bool doubles, const SpoolSpace* space,
                          size_t memory_bytes, Spool* vertices,
                          const std::function<Status(const std::array<uint32_t, 3>&)>& receive);

}  // namespace mtdb::internal
