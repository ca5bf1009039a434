// SPDX-License-Identifier: Apache-2.0
// The shape "sheets": what is not a manifold, in the amounts that models and scans have.
#pragma once

#include <cstdint>

#include "store/base/mesh_sink.h"
#include "store/base/status.h"

namespace mtdb::internal {

// What a mesh of a wanted size is made of.
struct SheetsPlan {
  uint64_t columns = 0, rows = 0;  // of the base (sheets_base.h)
  uint64_t fins = 0, flaps = 0, crumbs = 0;
  uint64_t fin_columns = 0, fin_rows = 0;  // of all fins together, in edges
};
SheetsPlan PlanSheets(uint64_t triangles, uint64_t seed);

// As tools/generate/generate.h says. Memory: constant.
Status SendSheets(uint64_t triangles, uint64_t seed, MeshSink& sink);

}  // namespace mtdb::internal
