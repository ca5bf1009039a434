// SPDX-License-Identifier: Apache-2.0
// WriteNeuroglancer: objects of a store as segments of a multi-resolution mesh for neuroglancer.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "query/surface.h"
#include "store/object_record.h"
#include "tools/tiles/tile_set.h"

namespace mtdb {

struct NeuroglancerSegment {
  uint64_t id = 0;
  ObjectRecord record;
};

struct NeuroglancerSetOptions {
  std::optional<Vec3d> resolution;  // nanometres of a unit; none: of the object's own units
  int bits = 16;                    // of positions in a fragment: 10 or 16
  uint64_t tile_triangles = 50'000;
  // Clients draw a level when its error covers so many pixels as they have set, 10 at first. The
  // mesh says errors so much larger that they then refine at `pixels`.
  double pixels = 2;
  bool sharded = false;
};

// Nanometres of a unit of the object's lengths; 1 where nobody said what they are in.
double NanometresOf(const ObjectRecord& record);

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
