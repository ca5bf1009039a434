// SPDX-License-Identifier: Apache-2.0
// 3D Tiles Archive Format 1.3 (.3tz): a folder of 3D Tiles in one zip file, with an index of names.
#pragma once

#include <memory>
#include <string>

#include "store/base/status.h"
#include "tools/tiles/verify/tile_files.h"

namespace mtdb {

// All files of the folder, as they are: tiles are compressed already. The archive appears when it
// is whole. Errors: those of files.
Status PackThreeTz(const std::string& folder, const std::string& path);
// Finds files by the index alone. kNotFound, kCorrupt.
Result<std::unique_ptr<TileFiles>> OpenThreeTz(const std::string& path);

}  // namespace mtdb
