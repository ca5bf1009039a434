// SPDX-License-Identifier: Apache-2.0
// VerifyTiles: whether a folder's tiles are what they say of an object.
#pragma once

#include <string>

#include "query/surface.h"
#include "store/base/status.h"
#include "store/check_report.h"

namespace mtdb {

// Of 3D Tiles and quantized-mesh as WriteTileSet writes them: they are of this version of the
// object; every file is there and can be read; boxes contain what is in them, and errors fall; and
// some points of each tile are as near to the full resolution as the tile says, which the report
// tells with the largest distance as a part of the stated one. What is wrong goes to the report.
// Errors: kNotFound (no tiles by mtdb are there), those of the surface.
Status VerifyTiles(const Surface& surface, const std::string& folder, CheckReport* report);

}  // namespace mtdb
