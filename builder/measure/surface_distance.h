// SPDX-License-Identifier: Apache-2.0
// SurfaceDistance: the error measure of surfaces in space, a bound on the two-sided distance.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "builder/measure/filling_lanes.h"
#include "builder/measure/filling_measure.h"
#include "builder/measure/slip.h"
#include "builder/measure/surface_map.h"
#include "builder/measure/tile_measure.h"

namespace mtdb::internal {

// Bounds the two-sided distance between a triangle and the part of the surface that it stands for,
// by how far the surface's removed vertices are from their homes, and its edges from the edges that
// they cross (docs/design.md, section 3; SurfaceMap). Of textured tiles, distances are the larger
// of those in space and of those in the image (TileTexture::scale). A removed vertex's home is the
// triangle of the filling that is nearest to it. Where the star is folded, shapes choose the
// filling.
class SurfaceDistance : public TileMeasure {
 public:
  static constexpr ErrorMeasure kMeasure = ErrorMeasure::kTwoSidedDistance;

  SurfaceDistance() : TileMeasure(false) {}

  void Begin(const TileMesh& mesh, std::span<const TileTriangle> tile, const Grid& grid,
             const MeasureOptions& options);
  void End(TileResult& result) const;
  void Open(Hole& hole);
  bool Sees(const Hole& hole) const { return hole.area > 0; }
  bool MeasuresFolds() const { return true; }
  bool PriceEdges(Hole& hole);
  double FirstBound(const Hole& hole, const Filling& filling, double enough);
  void MeasureEdges(Hole& hole, const Filling& filling, const Hole::PerEdge<bool>& known);
  void Measure(const Hole& hole, Filling& filling);
  void HandOn(const Hole& hole, const Filling& filling, uint32_t first);

 private:
  void LoadTexture(const MeasureOptions& options, std::span<const uint32_t> local);
  bool textured() const { return !texture_.empty(); }
  TexturedPoint At(uint32_t v) const { return {positions_[v], texture_[v]}; }
  // The parts of the surface and of the mesh: a vertex and a triangle of a filling, two edges.
  double FromTriangle(const Hole& hole, uint32_t v, const Hole::Triangle& triangle) const;
  double FromDiagonal(const Hole& hole, uint32_t a, uint32_t b, uint32_t i, uint32_t j) const;
  void MeasureBorder(Hole& hole) const;
  bool FindParts(const Hole& hole);
  void LookAt(const Hole& hole, const Filling& filling);
  void FindHomes(const Hole& hole);
  void PlaceEnds(const Hole& hole);
  // Of a point from its home, not of a star of the surface itself.
  double AboutDistance(size_t s) const { return std::sqrt(double{squared_[s]}) * star_.size; }
  void MeasureFreshEdges(Hole& hole, const Filling& filling);
  void MeasureCrossings(const Hole& hole, const Filling& filling,
                        std::array<double, Hole::kMaxRing>& errors) const;

  SurfaceMap map_;
  std::vector<Vec3d> texture_;  // of vertices, scaled: (u, v, 0); empty: not textured
  // Of the open hole. Samples behind the points lie on the new border edge.
  struct Star {
    bool fresh = false;  // it is one of the surface itself
    double size = 0;     // how far ring and points are from the frame's origin
  } star_;
  bool looked_ = false, known_ = false;  // the parts of paths in it are looked for, and known
  bool looked_at_ = false;               // a filling, of which ...
  bool at_home_ = false;                 // ... the homes are known, and ...
  bool placed_ = false;                  // ... the masks
  Hole::Triangles seen_;
  FillingLanes lanes_;
  std::vector<uint32_t> homes_;  // of the samples: triangles of the filling
  std::vector<float> squared_;   // distances of the points from these, about, over star_.size
  double distance_ = 0;          // of the one point of a star of the surface itself
  SurfaceMap::Masks masks_;
  std::vector<std::pair<uint8_t, uint32_t>> charges_;
};
static_assert(FillingMeasure<SurfaceDistance>);

}  // namespace mtdb::internal
