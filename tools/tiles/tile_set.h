// SPDX-License-Identifier: Apache-2.0
// WriteTileSet: an object as a tree of tiles for other people's programs. Start here.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "query/surface.h"
#include "store/base/status.h"
#include "tools/tiles/tile_format.h"

namespace mtdb {

// As records and reports have it. UnexpectedJson (json_reading.h): it is damaged.
Json TileLevelJson(const TileLevel& level);
TileLevel TileLevelOf(const Json& json);

struct TileSetOptions {
  uint64_t memory_bytes = uint64_t{256} << 20;  // beside the surface's cache
  unsigned threads = 1;                         // that encode tiles
  std::string tmp_directory;  // of temporary files, some 60 bytes a triangle of the object
  Json identity;              // what the tiles follow from, beside the object and the format
  bool force = false;         // replaces tiles of something else
  // From 0 to 1, and what is going on; an error ends the work. May be null.
  std::function<Status(double, const std::string&)> progress;
};

struct TileSetReport {
  std::vector<TileLevel> levels;  // coarse to fine
  uint64_t files = 0;             // beside the tiles
  uint64_t file_bytes = 0;        // of these
  uint32_t levels_found = 0;      // that an earlier run had written
};

// Writes the tree into the folder `path`. What is there of it, from a run that was interrupted, is
// not made again: a level that was complete is taken. The same object and options give the same
// bytes, whatever the memory and the number of threads.
//
// How: for each level one cut of the whole object goes to temporary files; its triangles are sorted
// by tiles; threads encode the tiles. Memory: that of the surface, 32 bytes for each of the
// triangles that are sorted at a time, the tiles that are encoded, and some 300 bytes for each tile
// there is.
//
// Errors: kAlreadyExists (tile_folder.h), those of the surface and of files, the format's.
Result<TileSetReport> WriteTileSet(const Surface& surface, const std::string& path,
                                   TileFormat& format, const TileSetOptions& options);

}  // namespace mtdb
