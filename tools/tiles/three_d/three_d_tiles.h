// SPDX-License-Identifier: Apache-2.0
// ThreeDTiles: an object as 3D Tiles 1.1 (OGC 22-025r4), for Cesium, QGIS, three.js and others.
#pragma once

#include <array>
#include <memory>
#include <optional>

#include "store/object_record.h"
#include "tools/tiles/places/geodesy.h"
#include "tools/tiles/tile_format.h"

namespace mtdb {

struct ThreeDTilesOptions {
  std::optional<GlobePlace> at;      // where the middle of the object's floor lies on the globe
  uint64_t tile_triangles = 50'000;  // about so many a tile
  // Clients refine a tile when its error covers so many pixels, as the tile set says it. Most have
  // 16 set; the set then says 16 / pixels times the true bound, so that they refine at `pixels`.
  double pixels = 2;
};

// Tiles are glTF (gltf_tile.h), in an octree, or of terrains a quadtree, that replaces a tile by
// its children. A level has four times the triangles of the one before, the last one all; its bound
// counts what positions were rounded by. Whole triangles belong to tiles: to each whose cell they
// meet. So a level is the cut's mesh, whose triangles in several tiles are equal in all of them,
// and has no cracks. Between two levels tiles overlap by the triangles across the cell's border,
// and skirts of the sum of both bounds shut what is left.
//
// A terrain in degrees lies on the globe by itself, and `at` is kInvalidArgument; others without
// `at` lie in space of their own. Lengths are in metres where the object has units.
Result<std::unique_ptr<TileFormat>> MakeThreeDTiles(const ObjectRecord& record,
                                                    const ThreeDTilesOptions& options);

}  // namespace mtdb
