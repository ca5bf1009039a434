// SPDX-License-Identifier: Apache-2.0
// FillingMeasure: how far a filled hole is from the input, and what of that is handed on.
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <span>

#include "builder/disk/tile.h"
#include "builder/holes/hole.h"
#include "builder/holes/tile_mesh.h"
#include "builder/measure/tile_surface.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"
#include "store/object_record.h"

namespace mtdb::internal {

// Of a height field whose border moves: work units along x and y to lengths in units of height.
struct BorderPlane {
  std::array<double, 4> plane{1, 0, 0, 1};
  Vec3d Place(Vec3d p) const {
    return {plane[0] * p.x + plane[1] * p.y, plane[2] * p.x + plane[3] * p.y, p.z};
  }
};

// What the errors of a tile are measured against.
struct MeasureOptions {
  const TileSurface* surface = nullptr;  // null: the tile itself. Of measures that go on
  const BorderPlane* border = nullptr;   // null: borders keep their shape. Of height fields
  // Of textured tiles, whose corners' rows have so many bytes. Of surfaces in space.
  const TriangleBlock* textured = nullptr;
  size_t row_bytes = 0;
  double texture_scale = 0;  // TileTexture::scale
};

// A measure is asked of one tile after the other, and for each in this order:
//   Begin       the tile as it comes, with the errors of its triangles; the mesh stays where it is
//   FirstGuess  when a vertex should be looked at first: about its error, rather too low
// and for a vertex, whose hole is open in the mesh:
//   Open        looks at the hole (Hole::LookAlong), and measures the new border edge
//   Sees        false when the hole is folded, seen along that direction: a measure that
//               MeasuresFolds is asked all the same, but for prices; with others the vertex stays
//   PriceEdges  sets the error of every diagonal that may be used, for rules that want them; true
//               when all are measured, false when some are guesses
//   FirstBound  of a filling whose diagonals are not measured: what its error is at least; it need
//               not look further when that is more than `enough`
//   MeasureEdges  measures the diagonals of a filling, of which some were `known` as parts of
//               others; negative: it cannot be
//   LowerBound  of such a filling: what its error is at least, for less than it takes to find it
//   Measure     its errors
//   HandOn      the filling has been put in the mesh, its triangles numbered from `first`
// and when all removals are made:
//   End         sets the errors of all local triangles, current and past, and, if the measure goes
//               on from round to round, what the next one has to know for that (TileSurface)
// A vertical measure is one of height fields, whose edges are all free (TileMesh::Load).
//
// What a measure promises: the error of a filling is a bound on the distance, in the sense of
// kMeasure, between each of its triangles and the part of the tile that the triangle stands for,
// plus what that part's triangles brought along as their errors; so the errors of several rounds
// add up to a bound against the input. Work units. Deterministic. One object serves one thread.
template <typename M>
concept FillingMeasure = requires(M measure, const M& constant, const TileMesh& mesh,
                                  std::span<const TileTriangle> tile, const Grid& grid,
                                  const MeasureOptions& options, Hole& hole, const Hole& filled,
                                  Filling& filling, uint32_t n, const Hole::PerEdge<bool>& known,
                                  TileResult& result) {
  { M::kMeasure } -> std::convertible_to<ErrorMeasure>;
  measure.Begin(mesh, tile, grid, options);
  { constant.FirstGuess(n) } -> std::convertible_to<double>;
  measure.Open(hole);
  { measure.Sees(filled) } -> std::same_as<bool>;
  { constant.MeasuresFolds() } -> std::same_as<bool>;
  { measure.PriceEdges(hole) } -> std::same_as<bool>;
  { measure.FirstBound(filled, filling, 0.0) } -> std::convertible_to<double>;
  measure.MeasureEdges(hole, filling, known);
  { constant.LowerBound(filled, filling) } -> std::convertible_to<double>;
  measure.Measure(filled, filling);
  measure.HandOn(filled, filling, n);
  constant.End(result);
};

// What most measures say.
struct MeasureDefaults {
  bool MeasuresFolds() const { return false; }
  double FirstBound(const Hole&, const Filling&, double) const { return 0; }
  double LowerBound(const Hole&, const Filling&) const { return 0; }
};

}  // namespace mtdb::internal
