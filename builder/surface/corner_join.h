// SPDX-License-Identifier: Apache-2.0
// CornerJoin: gives every triangle of the input its corners' positions, and says what kind of
// surface it belongs to, in memory that does not depend on the input's size.
#pragma once

#include <functional>

#include "builder/disk/tile.h"
#include "builder/intake/input_mesh.h"
#include "builder/mesh_survey.h"
#include "store/base/grid.h"
#include "store/base/status.h"
#include "store/object_record.h"

namespace mtdb::internal {

struct JoinTotals {
  uint64_t vertices = 0;             // referenced by a kept triangle
  uint64_t triangles = 0;            // kept; those that are two-sided count twice
  uint64_t two_sided_triangles = 0;  // pairs of opposite ones
  uint64_t edges = 0;
  uint64_t boundary_edges = 0;
  uint64_t unreferenced_vertices = 0;
  uint64_t duplicate_triangles = 0;
  uint64_t nonmanifold_edges = 0;
  uint64_t inconsistent_edges = 0;  // of them: of two triangles that run in the same direction
  SheetReport sheets;               // when there are such, unless they are known
  uint64_t nonmanifold_vertices = 0;
  double rounding_error = 0;  // see ObjectRecord
  // Sums over edges, in space (model units) and in the image, of kept triangles of some extent in
  // the image.
  double lengths = 0, texture_lengths = 0;
};

struct JoinOptions {
  const SpoolSpace* space = nullptr;
  size_t memory_bytes = 0;  // for spools
  size_t table_bytes = 0;   // for the tables of the ranges at work; at least 1 MiB is taken
  unsigned threads = 1;
  bool sheets_known = false;
};

// Vertices are cut into ranges of numbers that fit the memory. A first pass over the triangles
// sends each corner, with the edge opposite to it, to the range of its vertex. Then, range by
// range, the edges opposite to a vertex (its link) tell all about it:
// - an edge vx occurs as often as x is an end of a link edge: once on the border, twice (once in
//   each direction) inside a manifold; otherwise it is non-manifold. All but the second are creases
//   (docs/glossary.md), and as often is their order;
// - two link edges that are each other's reverse are two triangles back to back: one that is
//   two-sided, and counts once from then on. An edge of two such triangles and of no others is no
//   crease, however these two run;
// - a path of link edges between creases is a fan. A vertex with two creases that all its fans join
//   is on a chain; it stays when it has other creases, or several fans. Fans are numbered, those of
//   many triangles first, when a vertex has 2 .. kMostOrder;
// - of textured meshes, an edge at whose ends the corners of its two triangles differ is a seam, a
//   crease of order 2. Then fans beyond kMostOrder have numbers, too, as if they were vertices, so
//   that a number has one corner. Triangles are opposite only when their corners are equal;
// - a link edge that repeats is a duplicate triangle: the first in the input's order stays.
// The last pass over the triangles meets the answers in the order of the questions. It turns
// two-sided triangles over that do not run as their neighbours do (sheet_orientation.h).
//
// The input's vertices and triangles are gone afterwards: their room on the disk goes back on the
// way.
//
// Errors: kBudgetExceeded (a range's tables are larger than `table_bytes`), and those of Spool.
//
// Passes the kept triangles to `receive` in blocks, in the input's order; vertices, positions,
// edges and fans are set. A row is that of the corner's vertex and, of textured meshes, the corner.
// All totals but the number of kept triangles are there before the first block.
using BlockReceiver = std::function<Status(TriangleBlock)>;
Status JoinCorners(InputMesh& input, const Grid& grid, const JoinOptions& options,
                   JoinTotals* totals, const BlockReceiver& receive);

}  // namespace mtdb::internal
