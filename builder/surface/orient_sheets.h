// SPDX-License-Identifier: Apache-2.0
// OrientSheets: makes the triangles of each sheet run alike, out of core; CountSheets says what
// that would do.
#pragma once

#include <cstddef>
#include <cstdint>

#include "builder/intake/input_mesh.h"
#include "builder/mesh_survey.h"
#include "store/base/status.h"

namespace mtdb::internal {

// sheet_links.h says what a sheet is, sheet_sides.h which orientation it gets. `memory_bytes` is
// what tables and spools take, and 1 MiB in any case. Errors: kBudgetExceeded (the triangles are
// too many for the memory), and those of Spool.
Result<SheetReport> CountSheets(const Spool& triangles, uint64_t vertices, const SpoolSpace* space,
                                size_t memory_bytes);
Result<SheetReport> OrientSheets(InputMesh* input, const SpoolSpace* space, size_t memory_bytes);

// How long blocks of SheetSides are, when there are as few as the memory takes.
Result<uint32_t> SheetBlock(uint64_t triangles, uint64_t table_bytes);

}  // namespace mtdb::internal
