// SPDX-License-Identifier: Apache-2.0
// FindSheetLinks: which triangles of the input hang together in sheets, out of core.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "builder/disk/spool.h"
#include "store/base/status.h"

namespace mtdb::internal {

// Two triangles that belong to one sheet, by their numbers in the input, a < b.
struct SheetLink {
  uint64_t a = 0, b = 0;
  bool turned = false;  // they disagree: one of them has to be turned over, or both stay
};

// `triangles`: three uint32 each, all different. A sheet hangs together across edges of exactly two
// triangles; what is back to back with another one (two-sided) is in none, and parts sheets as a
// third triangle does. Triangles that repeat an earlier one belong to its sheet, and count as one
// with it.
//
// Vertices are cut into ranges that fit the memory; each triangle goes to the range of its smallest
// vertex, and of the next one, where each edge meets its others. `receive` gets all links, an edge
// one, in no order. Returns at how many edges they disagree. Errors: kBudgetExceeded (a range is
// larger than the memory), and those of Spool and `receive`.
using SheetLinkReceiver = std::function<Status(const SheetLink&)>;
Result<uint64_t> FindSheetLinks(const Spool& triangles, uint64_t vertices, const SpoolSpace* space,
                                size_t memory_bytes, const SheetLinkReceiver& receive);

}  // namespace mtdb::internal
