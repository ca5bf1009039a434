// SPDX-License-Identifier: Apache-2.0
// Terrains of rasters that a test makes.
#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "tests/builder/fixture.h"
#include "tests/support/memory_raster.h"

namespace mtdb::testing {

struct Terrain {
  uint32_t columns = 0, rows = 0;
  std::vector<double> heights;
  RasterFrame frame;
  BuiltObject built;
};

// Builds it with tiles so small that there are many seams.
inline Terrain BuildTerrain(uint32_t columns, uint32_t rows, std::vector<double> heights,
                            Triangulation triangulation, bool border_moves = false) {
  Terrain t{columns, rows, heights, {}, {}};
  auto raster = std::make_unique<MemoryRaster>(columns, rows, std::move(heights));
  raster->info().frame.geotransform = {100, 0.25, 0, 50, 0, -0.5};
  if (border_moves) raster->info().frame.geotransform = {100, 30, 5, 50, 10, -30};
  t.frame = raster->info().frame;
  RasterMosaic mosaic = MosaicOf(std::move(raster));
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  RasterMeshReport report;
  REQUIRE(SendRaster(mosaic, {}, sink, &report).message() == "");
  BuildOptions options;
  options.terrain = TerrainInput{GridOf(t.frame, 1, 0), t.frame, "", triangulation, {}};
  if (border_moves) {
    options.terrain->reading = [&] { return TerrainInput::Reading{0, 0, report.holes}; };
  }
  options.tile_triangles = 600;
  options.threads = 1;
  t.built = Build(mesh, options);
  REQUIRE(t.built.record.error_measure == ErrorMeasure::kVertical);
  REQUIRE(t.built.record.rounding_error == 0);
  return t;
}

inline std::vector<double> WithHoles(std::vector<double> heights, uint32_t columns, uint32_t rows) {
  for (uint32_t r = 0; r < rows; ++r) {
    for (uint32_t c = 0; c < columns; ++c) {
      const double x = c - 0.62 * columns;
      const double y = r - 0.4 * rows;
      const bool lake = x * x + 2 * y * y < 90;
      const bool collar = 3 * c + r < 30 || r + 40 > 4 * (columns - c) + rows;
      if (lake || collar || (c % 31 == 17 && r % 29 == 13))
        heights[size_t{r} * columns + c] = kHole;
    }
  }
  return heights;
}

}  // namespace mtdb::testing
