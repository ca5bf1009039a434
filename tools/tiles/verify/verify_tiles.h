// SPDX-License-Identifier: Apache-2.0
// VerifyTiles: whether tiles in a folder or an archive are what they say of an object.
#pragma once

#include <string>

#include "query/surface.h"
#include "store/base/status.h"
#include "store/check_report.h"

namespace mtdb {

// Of all kinds of tiles as `mtdb tile` writes them: they are of this version of the object; every
// file is there and can be read; boxes contain what is in them, and errors fall; and some points of
// each tile are as near to the full resolution as the tile says, which the report tells with the
// largest distance as a part of the stated one. Of neuroglancer also that parts of fragments can be
// drawn alone. What is wrong goes to the report. Errors: kNotFound (no tiles by mtdb are there),
// kCorrupt (an archive that cannot be opened), those of the surface.
Status VerifyTiles(const Surface& surface, const std::string& path, CheckReport* report);

}  // namespace mtdb
