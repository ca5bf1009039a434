// SPDX-License-Identifier: Apache-2.0
// QuantizedMesh: a terrain as quantized-mesh 1.0, for the globes of Cesium and QGIS.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "store/object_record.h"
#include "tools/tiles/tile_format.h"

namespace mtdb {

struct QuantizedMeshOptions {
  bool mercator = false;              // tiles of Web Mercator, else of degrees
  std::optional<uint32_t> max_level;  // none: the first whose tiles have 64 of the raster's rows
};

// Clients take for level l an error of 77,067 m / 2^l (of Web Mercator twice as much), and so it
// is: the level's tiles are pieces of one cut whose bound, with what rounding of heights and the
// globe's curvature add, is at most that, as far as the terrain itself has it. Triangles are cut at
// the sides of tiles, from the ends of their edges alone, and a level has one step of heights: so
// neighbours have the same vertices on their common side, to the unit. Where the raster ends within
// a tile, ground of height 0 goes on, and a wall goes down to it. Holes stay holes.
//
// Errors: kInvalidArgument: the object is no terrain in degrees.
Result<std::unique_ptr<TileFormat>> MakeQuantizedMesh(const ObjectRecord& record,
                                                      const QuantizedMeshOptions& options);

// What whoever looks at the terrain should know of its heights: empty, or a sentence.
std::string HeightWarning(const ObjectRecord& record);

}  // namespace mtdb
