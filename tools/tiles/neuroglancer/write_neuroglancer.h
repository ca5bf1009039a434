// SPDX-License-Identifier: Apache-2.0
// WriteNeuroglancer: objects of a store as segments of a multi-resolution mesh for neuroglancer.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "query/surface.h"
#include "store/object_record.h"
#include "tools/tiles/neuroglancer/neuroglancer_info.h"
#include "tools/tiles/tile_set.h"

namespace mtdb {

using SurfaceOpener = std::function<Result<std::shared_ptr<Surface>>(const ObjectRecord& record)>;

// Writes "neuroglancer_multilod_draco" into the folder: info, segment_properties, and for each
// segment its fragments and manifest, in files of their own or in shards. Fragments are written as
// WriteTileSet does, into the folder "parts", which goes when all are there; a killed run goes on
// with it. Segments are sorted by id, and none has the id of another.
//
// Errors: kInvalidArgument (a terrain in degrees), those of WriteTileSet and `open`.
Result<TileSetReport> WriteNeuroglancer(const std::vector<NeuroglancerSegment>& segments,
                                        const SurfaceOpener& open, const std::string& path,
                                        const NeuroglancerSetOptions& set,
                                        const TileSetOptions& options);

}  // namespace mtdb
