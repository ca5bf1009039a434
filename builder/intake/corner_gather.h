// SPDX-License-Identifier: Apache-2.0
// GatherCorners: looks up the rows of a table for the corners of triangles, out of core.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "builder/disk/spool.h"
#include "store/base/status.h"

namespace mtdb::internal {

// A table of `rows` rows in a finished spool, one behind the other: of each row's `stride` bytes,
// the first `bytes` are looked up.
struct CornerTable {
  const Spool* spool = nullptr;
  uint64_t rows = 0;
  size_t stride = 0;
  size_t bytes = 0;
};

// `triangles` holds three uint32 a triangle, each the number of a row. `receive` gets the triangles
// in their order, with what the table has for each corner; the pointers are valid during the call.
//
// A table that fits `memory_bytes` is looked up in memory. A larger one is cut into ranges: a first
// pass sends each corner to the range of its row, the ranges are answered one by one, and the last
// pass meets the answers in the order of the questions. Errors: kBudgetExceeded (a range of the
// table is larger than the memory), and those of Spool and `receive`.
using CornersReceiver =
    std::function<Status(const std::array<uint32_t, 3>&, const std::array<const std::byte*, 3>&)>;
Status GatherCorners(const Spool& triangles, const CornerTable& table, const SpoolSpace* space,
                     size_t memory_bytes, const CornersReceiver& receive);

}  // namespace mtdb::internal
