// SPDX-License-Identifier: Apache-2.0
// FillingMeasure: how far a filled hole is from the input, and what of that is handed on.
#pragma once

#include <concepts>
#include <cstdint>
#include <span>
#include <vector>

#include "builder/disk/tile.h"
#include "builder/holes/hole.h"
#include "builder/holes/tile_mesh.h"
#include "store/object_record.h"

namespace mtdb::internal {

// A measure is asked of one tile after the other, and for each in this order:
//   Load        the tile as it comes, with the errors of its triangles; the mesh stays where it is
//   FirstGuess  when a vertex should be looked at first: about its error, rather too low
// and for a vertex, whose hole is open in the mesh:
//   Open        looks at the hole (Hole::LookAlong), and measures the new border edge
//   Sees        false when the hole is folded, seen along that direction: a measure with
//               kMeasuresFolds is asked all the same, but for prices; with others the vertex stays
//   PriceEdges  sets the error of every diagonal that may be used, for rules that want them; true
//               when all are measured, false when some are guesses
//   FirstBound  of a filling whose diagonals are not measured: what its error is at least; it need
//               not look further when that is more than `enough`
//   MeasureEdges  measures the diagonals of a filling, of which some were `known` as parts of
//               others; negative: it cannot be
//   LowerBound  of such a filling: what its error is at least, for less than it takes to find it
//   Measure     its errors
//   HandOn      the filling has been put in the mesh, its triangles numbered from `first`
// With kIsHeightField edges are segments in the plane, so that no two of them have the same ends:
// no removal need look for edges that exist. A measure with kGoesOn can be given another surface
// than the tile with Load, and says by Hold what the next round has to know to go on (TileSurface).
// errors() are then the bounds of all local triangles, current and past.
//
// What a measure promises: the error of a filling is a bound on the distance, in the sense of
// kMeasure, between each of its triangles and the part of the tile that the triangle stands for,
// plus what that part's triangles brought along as their errors; so the errors of several rounds
// add up to a bound against the input. Work units. Deterministic. One object serves one thread.
template <typename M>
concept FillingMeasure = requires(M measure, const M& constant, const TileMesh& mesh,
                                  std::span<const TileTriangle> tile, Hole& hole,
                                  const Hole& filled, Filling& filling, uint32_t n,
                                  const Hole::PerEdge<bool>& known) {
  { M::kMeasure } -> std::convertible_to<ErrorMeasure>;
  { M::kMeasuresFolds } -> std::convertible_to<bool>;
  { M::kGoesOn } -> std::convertible_to<bool>;
  { M::kIsHeightField } -> std::convertible_to<bool>;
  { constant.FirstGuess(n) } -> std::convertible_to<double>;
  measure.Open(hole);
  { measure.Sees(filled) } -> std::same_as<bool>;
  { measure.PriceEdges(hole) } -> std::same_as<bool>;
  { measure.FirstBound(filled, filling, 0.0) } -> std::convertible_to<double>;
  measure.MeasureEdges(hole, filling, known);
  { constant.LowerBound(filled, filling) } -> std::convertible_to<double>;
  measure.Measure(filled, filling);
  measure.HandOn(filled, filling, n);
  { constant.errors() } -> std::convertible_to<std::vector<float>>;
};

}  // namespace mtdb::internal
