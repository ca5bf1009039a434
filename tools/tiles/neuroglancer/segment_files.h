// SPDX-License-Identifier: Apache-2.0
// MakeSegmentFiles: an object as neuroglancer's files, without a folder.
#pragma once

#include <memory>

#include "query/surface.h"
#include "tools/tiles/neuroglancer/neuroglancer_info.h"
#include "tools/tiles/tile_files.h"

namespace mtdb {

// The files that WriteNeuroglancer() writes of this object alone, whose id is its name, if that is
// a number, or 1. A manifest says how many bytes each fragment has: so all of them are encoded at
// once, into temporary files. Errors: those of CheckSegment(), the surface and files; kCancelled.
Result<std::unique_ptr<TileFiles>> MakeSegmentFiles(const Surface& surface,
                                                    const NeuroglancerSetOptions& set,
                                                    const TileFilesOptions& options);

}  // namespace mtdb
