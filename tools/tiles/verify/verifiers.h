// SPDX-License-Identifier: Apache-2.0
// The checks of each kind of tiles. What is wrong goes to the judge, and JSON that is not as it has
// to be is thrown as UnexpectedJson (json_reading.h).
#pragma once

#include <string>

#include "store/base/json.h"
#include "store/base/status.h"
#include "tools/tiles/verify/tile_files.h"
#include "tools/tiles/verify/tile_judge.h"

namespace mtdb {

// From tileset.json on.
Status VerifyThreeDTiles(const TileFiles& files, TileJudge* judge);
// From layer.json on.
Status VerifyQuantizedMesh(const TileFiles& files, TileJudge* judge);
// From tiles.json on.
Status VerifyTerrainRgb(const TileFiles& files, TileJudge* judge);
// One segment of the folder. `of`: what the record says that the tiles are of.
Status VerifyNeuroglancer(const std::string& folder, const Json& of, TileJudge* judge);

}  // namespace mtdb
