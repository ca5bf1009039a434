// SPDX-License-Identifier: Apache-2.0
// SeamJoin: joins the vertices of a mesh that was cut along edges, as exporters cut it at seams of
// textures or write each face by itself, out of core.
#pragma once

#include <cstdint>
#include <functional>

#include "builder/disk/spool.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Vertices (3 float32, or 3 float64 when `doubles`, then a row), and triangles of 3 uint32, in
// finished spools.
struct SeamJoinInput {
  const Spool* vertices = nullptr;
  size_t vertex_bytes = 0;
  bool doubles = false;
  const Spool* triangles = nullptr;
  // Unless empty: is told of each triangle, in their order, whether it has area.
  std::function<Status(bool)> told;
};

struct SeamJoinTotals {
  uint64_t vertices = 0;  // that are left
  uint64_t joined = 0;    // that became others
  // Of those left and used, the ones that lie where an earlier one does; and whether some edge
  // would join if the attributes at its ends agreed.
  uint64_t equal = 0;
  bool attributes_differ = false;
};

// Vertices are alike when position (-0 is +0) and row are equal, bit for bit. A triangle with two
// like corners has no area and goes. Two triangles that have an edge between like ends are joined
// there, corner by corner, when no third one has it, they run along it in opposite directions, and
// they do not lie back to back (the third corners are alike, or their planes are one, and the edge
// a fold). So like vertices that no such edge connects stay apart: those of sheets back to back, of
// bodies that touch, or with other attributes. The first of joined vertices stays.
//
// `left` gets the vertices that stay and `triangles` those with area, with new numbers, when
// `joined` is not 0; neither is finished. Costs a look at each position where all are different.
// Memory: three bits a vertex, and `memory_bytes`. Errors: kBudgetExceeded (too many vertices of
// one place, or edges of one hash, for the memory), and those of Spool.
Result<SeamJoinTotals> JoinSeams(const SeamJoinInput& input, const SpoolSpace* space,
                                 size_t memory_bytes, Spool* left, Spool* triangles);

}  // namespace mtdb::internal
