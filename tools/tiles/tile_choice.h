// SPDX-License-Identifier: Apache-2.0
// TileChoice: a kind of tiles and its options, as command lines and URLs name them.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "query/surface.h"
#include "store/base/json.h"
#include "store/object_record.h"
#include "tools/tiles/neuroglancer/neuroglancer_info.h"
#include "tools/tiles/places/geodesy.h"
#include "tools/tiles/tile_files.h"
#include "tools/tiles/tile_format.h"

namespace mtdb {

struct TileChoice {
  std::string format = "3dtiles";
  std::optional<GlobePlace> at;            // 3dtiles
  std::optional<double> pixels;            // 3dtiles, neuroglancer
  std::optional<uint64_t> tile_triangles;  // 3dtiles, neuroglancer
  bool mercator = false;                   // quantized-mesh
  std::optional<uint32_t> max_level;       // quantized-mesh, terrain-rgb
  std::optional<std::string> encoding;     // terrain-rgb: "terrarium" or "mapbox"
  std::optional<uint32_t> tile_pixels;     // terrain-rgb
  std::optional<Vec3d> resolution;         // neuroglancer: nanometres of a unit
  std::optional<int> bits;                 // neuroglancer
};

inline constexpr uint32_t kMostTileLevel = 22;

// "LON,LAT,HEIGHT", and how many triangles a tile shall have. kInvalidArgument.
Result<GlobePlace> ParseGlobePlace(const std::string& text);
Result<uint64_t> ParseTileTriangles(const std::string& text);
// "X,Y,Z" in nanometres, above 0.
Result<Vec3d> ParseResolution(const std::string& text);

// The option `name`, as `mtdb tile` has it without dashes, of a tree of one object.
// kInvalidArgument where the kind has no such option, or no such value.
Status SetTileOption(const std::string& name, const std::string& value, TileChoice* choice);

// Not of neuroglancer. `*identity`: what the tiles follow from, beside the object. Errors: those of
// the kinds.
Result<std::unique_ptr<TileFormat>> MakeTileFormat(const TileChoice& choice,
                                                   const ObjectRecord& record, Json* identity);
// Of neuroglancer; not whether it is sharded.
NeuroglancerSetOptions NeuroglancerSetOf(const TileChoice& choice);

// What the files of a tree follow from, beside the object and the kind. Errors: those of the kinds.
Result<Json> TileIdentityOf(const TileChoice& choice, const ObjectRecord& record);
// Any kind's files, made for who asks for one. Reads the whole object. Errors: those of the kinds,
// the surface and files; kCancelled.
Result<std::unique_ptr<TileFiles>> MakeTileFiles(const TileChoice& choice, const Surface& surface,
                                                 const TileFilesOptions& options);

}  // namespace mtdb
