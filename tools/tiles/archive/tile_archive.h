// SPDX-License-Identifier: Apache-2.0
// A tree of tiles as one file.
#pragma once

#include <string>

#include "store/base/status.h"

namespace mtdb {

// What follows an archive's name in that of the folder whose tiles become it.
inline constexpr char kArchiveParts[] = ".parts";

// Whether the path is one of an archive: .3tz or .pmtiles.
bool IsTileArchive(const std::string& path);
// kAlreadyExists where something is there and `force` is not set.
Status CheckTileArchive(const std::string& path, bool force);
// Makes the archive of the tiles in the folder, which then goes.
Status PackTiles(const std::string& folder, const std::string& path);

}  // namespace mtdb
