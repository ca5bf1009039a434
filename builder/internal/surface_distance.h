// SPDX-License-Identifier: Apache-2.0
// SurfaceDistance: the error measure of surfaces in space, a bound on the two-sided distance.
// HeightDifference: that of height fields.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "builder/internal/filling_measure.h"
#include "builder/internal/hole.h"
#include "builder/internal/raster_surface.h"
#include "builder/internal/round_mesh.h"
#include "builder/internal/tile.h"
#include "builder/internal/tile_mesh.h"
#include "builder/internal/tile_surface.h"

namespace mtdb::internal {

// Of a height field whose border moves: work units along x and y to lengths in units of height.
struct BorderPlane {
  std::array<double, 4> plane{1, 0, 0, 1};
  Vec3d Place(Vec3d p) const {
    return {plane[0] * p.x + plane[1] * p.y, plane[2] * p.x + plane[3] * p.y, p.z};
  }
};

// Bounds the two-sided distance between a triangle and the part of the round's input that it stands
// for, by the curves of its edges and by the removed vertices between these (docs/design.md,
// section 3; RoundMesh). Looks along the star's normal. A folded hole, where the input turns away
// from that or such a bound came before, gets a conservative one: by how far hole and star are
// apart, added to the star's errors.
//
// kVertical: the largest difference in height between the triangle and what lies above and below
// it, of height fields whose work units are integers along x and y. It is exact against the round's
// input: a difference of two piecewise linear functions is largest at a corner of their overlay,
// and those are the same crossings and removed vertices. Border vertices go where the border is
// straight; with MoveBorders also others that make the surface smaller: then the new border edge
// runs inside of it, and its error is that of its heights, or how far the vertices that it leaves
// outside are from it in space, whichever is larger.
template <ErrorMeasure kKind>
class SurfaceMeasure {
 public:
  static constexpr ErrorMeasure kMeasure = kKind;
  static constexpr bool kIsVertical = kKind == ErrorMeasure::kVertical;
  static constexpr bool kMeasuresFolds = !kIsVertical;
  static constexpr bool kIsHeightField = kIsVertical;
  static constexpr bool kGoesOn = true;

  // Until it is called again; null: borders keep their shape.
  void MoveBorders(const BorderPlane* plane) { border_plane_ = plane; }
  // `surface`: null, or a tile's of a round that goes on; `grid` gives its positions.
  void Load(const TileMesh& mesh, std::span<const TileTriangle> tile, const TileSurface* surface,
            const Grid& grid);
  // Sets what the next round has to know to go on.
  void Hold(TileResult& result) const;
  double FirstGuess(uint32_t v) const;
  void Open(Hole& hole);
  bool Sees(const Hole& hole) const;
  bool PriceEdges(Hole& hole);
  void MeasureEdge(Hole& hole, uint32_t i, uint32_t j) const;
  double LowerBound(const Hole& hole, const Filling& filling) const;
  void Measure(const Hole& hole, Filling& filling);
  void MeasureFolded(const Hole& hole, Filling& filling);
  void HandOn(const Hole& hole, const Filling& filling, uint32_t first);
  std::vector<float> errors() const;

 private:
  // What is known of a triangle, current or past: read together, of triangles anywhere in the tile.
  struct alignas(64) Triangle {
    // Of its edges' curves, and how far each may be from the edge, less than its error.
    std::array<double, 3> curve_errors{};
    std::array<float, 3> curve_reaches{};
    // Of border edges: removed border vertices on the edge's curve.
    std::array<uint32_t, 3> chain_heads{kNone32, kNone32, kNone32};
    float error = 0;
    // The removed vertices that it may stand for: all that it does, and some near by. A part of
    // held_, which keeps those of triangles that are gone for a while.
    uint32_t held_begin = 0, held_end = 0;
    bool own = false;           // of the tile's: it is one of the surface's
    bool conservative = false;  // made by a conservative bound, or in the place of such
  };
  // Of a half-edge.
  double curve_error(uint32_t h) const { return triangles_[h / 3].curve_errors[h % 3]; }
  uint32_t chain_head(uint32_t h) const { return triangles_[h / 3].chain_heads[h % 3]; }
  void LoadSurface(const TileSurface& surface, const Grid& grid);
  void BuildSurface(std::span<const std::array<uint32_t, 3>> triangles,
                    std::span<const float> errors, std::span<const uint32_t> opposites);
  // What the surface around one of its vertices has accumulated.
  bool is_raster() const { return kIsVertical && !raster_.empty(); }
  double vertex_error(uint32_t v) const { return is_raster() ? 0 : round_.vertex_error(v); }
  void MeasureHeights();
  void MeasureBorder(Hole& hole) const;
  void MeasureMovedBorder(Hole& hole);
  bool MovesInwards(const Hole& hole) const;
  // True when the star is the round's input, so that diagonals cross nothing but its spokes.
  bool IsFresh(const Hole& hole) const;
  void MeasureOverSpokes(Hole& hole) const;
  void GuessEdges(Hole& hole) const;
  void GatherSamples(const Hole& hole);
  double CurveError(const Hole& hole, uint32_t a, uint32_t b) const;
  double Reach(const Hole& hole, const Hole::Triangle& triangle) const;
  void ChargeSamples(const Hole& hole, Filling& filling);
  void Charge(const Hole& hole, Filling& filling, uint32_t t, uint32_t s, double reach);
  // The samples of a triangle, the last one that was charged to it first.
  std::span<const uint32_t> HeldBy(uint32_t triangle) const {
    const Triangle& t = triangles_[triangle];
    return std::span(held_).subspan(t.held_begin, t.held_end - t.held_begin);
  }
  // Gives sample `item[i].second` to triangle first + item[i].first.
  template <typename Items>
  void HoldIn(uint32_t first, uint32_t triangles, const Items& items);
  void FreeHeld(std::span<const uint32_t> triangles);
  uint32_t JoinBorderChains(const Hole& hole);

  const TileMesh* mesh_ = nullptr;
  const BorderPlane* border_plane_ = nullptr;
  // The surface: of a raster at full resolution the first one, else the second.
  RasterSurface raster_;
  RoundMesh round_;

  std::vector<Triangle> triangles_;
  std::vector<uint32_t> held_;
  size_t held_in_use_ = 0;
  // Vertices: the mesh's, then others of the surface.
  std::vector<Vec3d> positions_;
  std::vector<uint32_t> next_on_chain_;
  std::vector<uint32_t> opened_in_;  // the last hole that had it in its ring or as a sample
  std::vector<double> heights_;      // of the mesh's, when the surface is not the tile

  // Of the open hole.
  bool gathered_ = false;             // its samples are known
  std::vector<uint32_t> samples_;     // removed vertices of its star, and the one that goes
  std::vector<Vec3d> points_;         // their places in the hole's frame
  uint32_t opened_ = 0;               // its number
  std::vector<float> sample_errors_;  // what they bring along
  std::vector<float> x_, y_, z_;      // of the points; room for whole groups of four
  std::vector<uint8_t> is_charged_;   // of the samples
  // A triangle of the filling, and a sample that it may stand for.
  std::vector<std::pair<uint8_t, uint32_t>> charges_;
};
using SurfaceDistance = SurfaceMeasure<ErrorMeasure::kTwoSidedDistance>;
using HeightDifference = SurfaceMeasure<ErrorMeasure::kVertical>;
extern template class SurfaceMeasure<ErrorMeasure::kTwoSidedDistance>;
extern template class SurfaceMeasure<ErrorMeasure::kVertical>;
static_assert(FillingMeasure<SurfaceDistance>);
static_assert(FillingMeasure<HeightDifference>);

}  // namespace mtdb::internal
