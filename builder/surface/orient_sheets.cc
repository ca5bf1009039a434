// SPDX-License-Identifier: Apache-2.0
#include "builder/surface/orient_sheets.h"

#include <algorithm>
#include <string>

#include "builder/surface/sheet_links.h"
#include "builder/surface/sheet_sides.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMaxBlocks = 128;
constexpr uint64_t kLeastTableBytes = uint64_t{1} << 20;

struct FoundSheets {
  SheetSides sides;
  SheetReport report;
};

Result<FoundSheets> FindSheets(const Spool& triangles, uint64_t vertices, const SpoolSpace* space,
                               size_t memory_bytes) {
  const uint64_t count = triangles.size() / InputMesh::kTriangleBytes;
  MTDB_ASSIGN_OR_RETURN(const uint32_t block, SheetBlock(count, memory_bytes / 2));
  FoundSheets found{SheetSides({count, block, space, memory_bytes / 4}), {}};
  MTDB_ASSIGN_OR_RETURN(
      found.report.inconsistent_edges,
      FindSheetLinks(triangles, vertices, space, memory_bytes / 2,
                     [&](const SheetLink& link) { return found.sides.Link(link); }));
  MTDB_ASSIGN_OR_RETURN(const SheetCounts counts, found.sides.Count());
  found.report.unorientable_sheets = counts.unorientable;
  found.report.turned_triangles = counts.turned_triangles;
  return found;
}

}  // namespace

Result<uint32_t> SheetBlock(uint64_t triangles, uint64_t table_bytes) {
  const uint64_t blocks = std::clamp<uint64_t>(
      triangles * SheetSides::kTriangleBytes / std::max<uint64_t>(table_bytes, 1) + 1,
      triangles / ParitySets::kMost + 1, kMaxBlocks);
  const uint64_t block = (triangles - 1) / blocks + 1;
  const uint64_t need = block * SheetSides::kTriangleBytes;
  if (need <= std::max(table_bytes, kLeastTableBytes)) return static_cast<uint32_t>(block);
  return Status(StatusCode::kBudgetExceeded,
                "the sheets of " + std::to_string(triangles) + " triangles need " +
                    std::to_string((need >> 20) + 1) + " MiB to be found, " +
                    std::to_string(table_bytes >> 20) +
                    " MiB are left for that; allow more --memory");
}

Result<SheetReport> CountSheets(const Spool& triangles, uint64_t vertices, const SpoolSpace* space,
                                size_t memory_bytes) {
  MTDB_ASSIGN_OR_RETURN(const FoundSheets found,
                        FindSheets(triangles, vertices, space, memory_bytes));
  return found.report;
}

Result<SheetReport> OrientSheets(InputMesh* input, const SpoolSpace* space, size_t memory_bytes) {
  MTDB_ASSIGN_OR_RETURN(FoundSheets found, FindSheets(input->triangle_spool(), input->vertices(),
                                                      space, memory_bytes));
  if (found.report.turned_triangles == 0) return found.report;
  MTDB_RETURN_IF_ERROR(found.sides.Resolve());
  MTDB_RETURN_IF_ERROR(
      input->TurnOver(space, memory_bytes / 4, [&] { return found.sides.NextIsTurned(); }));
  return found.report;
}

}  // namespace mtdb::internal
