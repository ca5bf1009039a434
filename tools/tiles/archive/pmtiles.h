// SPDX-License-Identifier: Apache-2.0
// PMTiles 3: a folder of tiles z/x/y in one file, which any web server serves by ranges.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "store/base/status.h"
#include "tools/tiles/verify/tile_files.h"

namespace mtdb {

// A tile's place on the Hilbert curves of all levels, y from the north.
uint64_t PmtilesId(uint32_t level, uint32_t x, uint32_t y);

// The tiles z/x/y.png of the folder and, as metadata, its tiles.json with the record
// (tile_folder.h). The archive appears when it is whole. Tiles that are equal and small are there
// once. Memory: some 40 bytes a tile. Errors: those of files.
Status PackPmtiles(const std::string& folder, const std::string& path);
// kNotFound, kCorrupt.
Result<std::unique_ptr<TileFiles>> OpenPmtiles(const std::string& path);

}  // namespace mtdb
