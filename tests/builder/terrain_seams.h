// SPDX-License-Identifier: Apache-2.0
// A vertical error measure and the Delaunay rule, as plain as can be: what the builder's seams
// take. Height fields in grid mode only, whose border stays.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "builder/decimate/decimator.h"

namespace mtdb::testing {

using namespace internal;

// The largest difference in height between triangles a and b over what they have in common, seen
// from above; negative when that has no area.
double HeightDifference(const std::array<Vec3d, 3>& a, const std::array<Vec3d, 3>& b);

// The largest |height difference| between a triangle and the round's input above and below it,
// found by cutting it with every input triangle near by.
class VerticalMeasure : public MeasureDefaults {
 public:
  static constexpr ErrorMeasure kMeasure = ErrorMeasure::kVertical;

  void Begin(const TileMesh& mesh, std::span<const TileTriangle> tile, const Grid& grid,
             const MeasureOptions& options);
  double FirstGuess(uint32_t) const { return 0; }
  void Open(Hole& hole);
  bool Sees(const Hole& hole) const { return !hole.boundary; }
  bool PriceEdges(Hole& hole) const;
  void MeasureEdges(Hole& hole, const Filling&, const Hole::PerEdge<bool>&) const {
    hole.ForEachDiagonal([&](uint32_t i, uint32_t j) { hole.edge_error[i][j] = 0; });
  }
  void Measure(const Hole& hole, Filling& filling) const;
  void HandOn(const Hole& hole, const Filling& filling, uint32_t first);
  void End(TileResult& result) const { result.errors = errors_; }

 private:
  static constexpr size_t kBins = 24;  // along a side
  size_t BinOf(double value, int axis) const;

  std::vector<std::array<Vec3d, 3>> input_;
  std::vector<uint32_t> bins_[kBins * kBins];  // input triangles by the boxes that they touch
  Vec3d min_, max_;
  std::vector<float> errors_;
};
static_assert(FillingMeasure<VerticalMeasure>);

// The (constrained) Delaunay triangulation of the ring, seen along the measure's direction.
class DelaunayFilling {
 public:
  static constexpr bool kReadsEdgeErrors = false;
  void Open(const Hole&) {}
  bool Fill(const Hole& hole, Hole::Triangles& triangles) const;
};
static_assert(FillingRule<DelaunayFilling>);

using TerrainDecimator = Decimator<VerticalMeasure, DelaunayFilling>;

}  // namespace mtdb::testing
