// SPDX-License-Identifier: Apache-2.0
// MakeTerrainRgb: a terrain as pictures of heights in Web Mercator, for MapLibre, Mapbox, deck.gl.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "store/object_record.h"
#include "tools/tiles/terrain_rgb/height_image.h"
#include "tools/tiles/tile_format.h"

namespace mtdb {

struct TerrainRgbOptions {
  HeightCoding coding = kTerrarium;
  uint32_t side = 256;                // pixels
  std::optional<uint32_t> max_level;  // none: as fine as the raster
};

// A level's error: this part of a pixel at the equator. Rounding takes a quarter of it.
inline constexpr double kErrorOfPixel = 1.0 / 32;

// PNG of the colours' heights, sampled in the middle of pixels from the level's cut, and rounded to
// a step that halves with each level; tiles.json (TileJSON 3.0) has the levels' bounds, which hold
// at samples. Where there is no height it is 0. Errors: kInvalidArgument (no terrain in degrees,
// places beyond Web Mercator, heights beyond the coding).
Result<std::unique_ptr<TileFormat>> MakeTerrainRgb(const ObjectRecord& record,
                                                   const TerrainRgbOptions& options);

}  // namespace mtdb
