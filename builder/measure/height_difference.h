// SPDX-License-Identifier: Apache-2.0
// HeightDifference: the error measure of height fields.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "builder/measure/filling_measure.h"
#include "builder/measure/raster_surface.h"
#include "builder/measure/round_mesh.h"
#include "builder/measure/tile_measure.h"

namespace mtdb::internal {

// The largest difference in height between a triangle and what lies above and below it, of height
// fields whose work units are integers along x and y. It is exact against the round's input: a
// difference of two piecewise linear functions is largest at a corner of their overlay, and those
// are the crossings of the triangle's edges' curves (RoundMesh) and the removed vertices. Border
// vertices go where the border is straight; where borders move also others that make the surface
// smaller: then the new border edge runs inside of it, and its error is that of its heights, or how
// far the vertices that it leaves outside are from it in space, whichever is larger.
class HeightDifference : public TileMeasure {
 public:
  static constexpr ErrorMeasure kMeasure = ErrorMeasure::kVertical;

  HeightDifference() : TileMeasure(true) {}

  void Begin(const TileMesh& mesh, std::span<const TileTriangle> tile, const Grid& grid,
             const MeasureOptions& options);
  void Open(Hole& hole);
  bool Sees(const Hole& hole) const;
  bool PriceEdges(Hole& hole);
  void MeasureEdges(Hole& hole, const Filling& filling, const Hole::PerEdge<bool>& known) const;
  void Measure(const Hole& hole, Filling& filling);
  void HandOn(const Hole& hole, const Filling& filling, uint32_t first);

 private:
  void MeasureEdge(Hole& hole, uint32_t i, uint32_t j) const;
  void MeasureBorder(Hole& hole) const;
  void MeasureMovedBorder(Hole& hole);
  bool MovesInwards(const Hole& hole) const;
  void ChargeSamples(const Hole& hole, Filling& filling);
  void Charge(const Hole& hole, Filling& filling, uint32_t t, uint32_t s);

  const BorderPlane* border_plane_ = nullptr;
  // The surface: of a raster at full resolution the first one, else the second.
  RasterSurface raster_;
  RoundMesh round_;
  // Of the open hole.
  // A triangle of the filling, and a sample that it stands for.
  std::vector<std::pair<uint8_t, uint32_t>> charges_;
};
static_assert(FillingMeasure<HeightDifference>);

}  // namespace mtdb::internal
