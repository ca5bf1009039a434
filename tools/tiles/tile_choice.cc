// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/tile_choice.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "tools/request/arguments.h"
#include "tools/tiles/neuroglancer/segment_files.h"
#include "tools/tiles/quantized/quantized_mesh.h"
#include "tools/tiles/terrain_rgb/terrain_rgb.h"
#include "tools/tiles/three_d/three_d_tiles.h"
#include "tools/tiles/tile_provider.h"

namespace mtdb {

namespace {

Status SetPlace(const std::string& text, TileChoice* choice) {
  MTDB_ASSIGN_OR_RETURN(choice->at, ParseGlobePlace(text));
  return Status::Ok();
}
Status SetPixels(const std::string& text, TileChoice* choice) {
  MTDB_ASSIGN_OR_RETURN(choice->pixels, ParsePositive(text));
  return Status::Ok();
}
Status SetTriangles(const std::string& text, TileChoice* choice) {
  MTDB_ASSIGN_OR_RETURN(choice->tile_triangles, ParseTileTriangles(text));
  return Status::Ok();
}
Status SetMercator(const std::string& text, TileChoice* choice) {
  if (text != "true" && text != "false") return Unexpected(text, "true or false");
  choice->mercator = text == "true";
  return Status::Ok();
}
Status SetMostLevel(const std::string& text, TileChoice* choice) {
  MTDB_ASSIGN_OR_RETURN(const uint64_t level, ParseWholeNumber(text));
  if (level > kMostTileLevel) return Unexpected(text, "a level from 0 to 22");
  choice->max_level = static_cast<uint32_t>(level);
  return Status::Ok();
}
Status SetEncoding(const std::string& text, TileChoice* choice) {
  if (text != "terrarium" && text != "mapbox") return Unexpected(text, "terrarium or mapbox");
  choice->encoding = text;
  return Status::Ok();
}
Status SetTilePixels(const std::string& text, TileChoice* choice) {
  if (text != "256" && text != "512") return Unexpected(text, "256 or 512");
  choice->tile_pixels = text == "256" ? 256 : 512;
  return Status::Ok();
}

Status SetResolution(const std::string& text, TileChoice* choice) {
  MTDB_ASSIGN_OR_RETURN(choice->resolution, ParseResolution(text));
  return Status::Ok();
}
Status SetBits(const std::string& text, TileChoice* choice) {
  if (text != "10" && text != "16") return Unexpected(text, "10 or 16");
  choice->bits = text == "10" ? 10 : 16;
  return Status::Ok();
}

struct TileOption {
  std::string_view format, name;
  Status (*set)(const std::string& text, TileChoice* choice);
};
constexpr TileOption kTileOptions[] = {{"3dtiles", "at", SetPlace},
                                       {"3dtiles", "pixels", SetPixels},
                                       {"3dtiles", "tile-triangles", SetTriangles},
                                       {"quantized-mesh", "mercator", SetMercator},
                                       {"quantized-mesh", "max-level", SetMostLevel},
                                       {"terrain-rgb", "max-level", SetMostLevel},
                                       {"terrain-rgb", "encoding", SetEncoding},
                                       {"terrain-rgb", "tile-pixels", SetTilePixels},
                                       {"neuroglancer", "pixels", SetPixels},
                                       {"neuroglancer", "tile-triangles", SetTriangles},
                                       {"neuroglancer", "resolution", SetResolution},
                                       {"neuroglancer", "bits", SetBits}};

Result<std::unique_ptr<TileFormat>> TerrainRgbOf(const TileChoice& choice,
                                                 const ObjectRecord& record, Json* identity) {
  TerrainRgbOptions options;
  if (choice.encoding == "mapbox") options.coding = kMapbox;
  options.side = choice.tile_pixels.value_or(options.side);
  options.max_level = choice.max_level;
  *identity = {{"encoding", options.coding.name},
               {"tile_pixels", options.side},
               {"max_level", options.max_level ? Json(*options.max_level) : Json()}};
  return MakeTerrainRgb(record, options);
}

}  // namespace

Result<GlobePlace> ParseGlobePlace(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 3, "LON,LAT,HEIGHT"));
  if (std::abs(n[0]) > 360 || std::abs(n[1]) > 90) {
    return Unexpected(text, "LON,LAT,HEIGHT in degrees and metres, LAT from -90 to 90");
  }
  return GlobePlace{n[0], n[1], n[2]};
}

Result<uint64_t> ParseTileTriangles(const std::string& text) {
  const auto count = ParseCount(text);
  if (!count.ok() || (*count >= 100 && *count <= 10'000'000)) return count;
  return Unexpected(text, "a number from 100 to 10000000");
}

Result<Vec3d> ParseResolution(const std::string& text) {
  MTDB_ASSIGN_OR_RETURN(const std::vector<double> n, ParseNumbers(text, 3, "X,Y,Z"));
  const auto is_length = [](double v) { return v > 0 && v <= 1e15; };
  if (std::all_of(n.begin(), n.end(), is_length)) return Vec3d{n[0], n[1], n[2]};
  return Unexpected(text, "X,Y,Z in nanometres, above 0");
}

Status SetTileOption(const std::string& name, const std::string& value, TileChoice* choice) {
  std::string known;
  for (const TileOption& option : kTileOptions) {
    if (option.format != choice->format) continue;
    if (option.name == name) {
      const Status status = option.set(value, choice);
      return status.ok() ? status : InvalidArgument(name + ": " + status.message());
    }
    known += (known.empty() ? "" : ", ") + std::string(option.name);
  }
  return InvalidArgument(name + ": " + choice->format + " has no such option; it has " + known);
}

Result<std::unique_ptr<TileFormat>> MakeTileFormat(const TileChoice& choice,
                                                   const ObjectRecord& record, Json* identity) {
  if (choice.format == "terrain-rgb") return TerrainRgbOf(choice, record, identity);
  if (choice.format == "quantized-mesh") {
    *identity = {{"mercator", choice.mercator},
                 {"max_level", choice.max_level ? Json(*choice.max_level) : Json()}};
    return MakeQuantizedMesh(record, {choice.mercator, choice.max_level});
  }
  ThreeDTilesOptions options;
  options.at = choice.at;
  options.pixels = choice.pixels.value_or(options.pixels);
  options.tile_triangles = choice.tile_triangles.value_or(options.tile_triangles);
  *identity = {{"pixels", options.pixels}, {"tile_triangles", options.tile_triangles}};
  if (const auto& at = options.at) {
    (*identity)["at"] = {at->longitude, at->latitude, at->height};
  }
  return MakeThreeDTiles(record, options);
}

NeuroglancerSetOptions NeuroglancerSetOf(const TileChoice& choice) {
  NeuroglancerSetOptions set;
  set.resolution = choice.resolution;
  set.bits = choice.bits.value_or(set.bits);
  set.tile_triangles = choice.tile_triangles.value_or(set.tile_triangles);
  set.pixels = choice.pixels.value_or(set.pixels);
  return set;
}

Result<Json> TileIdentityOf(const TileChoice& choice, const ObjectRecord& record) {
  Json identity;
  if (choice.format == "neuroglancer") {
    MTDB_RETURN_IF_ERROR(CheckSegment(record));
    const NeuroglancerSetOptions set = NeuroglancerSetOf(choice);
    identity = {{"bits", set.bits}, {"tile_triangles", set.tile_triangles}, {"pixels", set.pixels}};
    if (const auto& r = set.resolution) identity["resolution"] = {r->x, r->y, r->z};
    return identity;
  }
  MTDB_ASSIGN_OR_RETURN(const auto format, MakeTileFormat(choice, record, &identity));
  return identity;
}

Result<std::unique_ptr<TileFiles>> MakeTileFiles(const TileChoice& choice, const Surface& surface,
                                                 const TileFilesOptions& options) {
  if (choice.format == "neuroglancer") {
    return MakeSegmentFiles(surface, NeuroglancerSetOf(choice), options);
  }
  Json identity;
  MTDB_ASSIGN_OR_RETURN(std::unique_ptr<TileFormat> format,
                        MakeTileFormat(choice, surface.record(), &identity));
  return TileProvider::Make(surface, std::move(format), options);
}

}  // namespace mtdb
