// SPDX-License-Identifier: Apache-2.0
// What `mtdb tile` is told, and the kinds of tiles that it makes of it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "store/database.h"
#include "store/object_record.h"
#include "tools/tiles/neuroglancer/write_neuroglancer.h"
#include "tools/tiles/tile_choice.h"

namespace mtdb {

// The kind of tiles, and what else is asked for.
struct TileArguments : TileChoice {
  std::string store;
  OpenOptions open;
  std::string output;  // a folder, or an archive
  std::string name;
  std::optional<std::string> ids;        // neuroglancer: a list, or "all"
  bool sharded = false;                  // neuroglancer
  std::optional<uint64_t> memory_bytes;  // none: a quarter of the machine's
  unsigned threads = 0;                  // 0: one per core
  std::string tmp;                       // folder of temporary files; empty: the output
  bool force = false, quiet = false, json = false;
};

// An option that is for another kind of tiles, or a name that is: kInvalidArgument.
Status CheckTileArguments(const TileArguments& arguments);

// The segments that --ids names, or the object of --name, by their ids. A name that is a number is
// its id; others get the least that are free, in the order of the names.
Result<std::vector<NeuroglancerSegment>> SegmentsOf(const TileArguments& arguments,
                                                    const Database& database);

// What is to be known of places, heights and lengths.
Json TileNotesOf(const TileArguments& arguments, const ObjectRecord& record);

}  // namespace mtdb
