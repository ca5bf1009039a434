// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/verify_tiles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

#include "query/heights.h"
#include "query/probe.h"
#include "store/base/coordinate_limit.h"
#include "store/base/out_of_memory.h"
#include "tools/request/read_file.h"
#include "tools/tiles/globe_grid.h"
#include "tools/tiles/gltf_tile.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/quantized_tile.h"
#include "tools/tiles/tile_folder.h"
#include "tools/tiles/tile_placement.h"

namespace mtdb {

namespace {

constexpr size_t kPointsOfTile = 24;
constexpr double kSlack = 1e-9;  // of sizes
constexpr size_t kMostFailures = 100;
// Files that link to files, each of which is a call within a call.
constexpr size_t kMostTilesets = 10'000;
constexpr size_t kMostLevels = 23;
constexpr double kHalfUnit = 0.51 / 32767;  // of a square's side

// Below the folder, whatever a tileset calls it.
Result<std::string> ContentOf(const std::string& folder, const std::string& name) {
  if (name.empty() || name.starts_with("/") || name.starts_with("..")) {
    return BadInput("lies outside of the folder");
  }
  std::error_code error;
  const std::string path = folder + "/" + name;
  if (!std::filesystem::is_regular_file(path, error)) return BadInput("is not there, or no file");
  return ReadFile(path);
}

// Empty where the record is damaged.
Json::Array RecordedLevels(const Json& record) {
  const Json& progress = record["progress"];
  const Json none;
  const Json& levels = progress.is_object() ? progress["levels"] : none;
  return levels.is_array() ? levels.elements() : Json::Array();
}

// Centre and half sides.
struct TileBox {
  Vec3d centre, half;
  explicit TileBox(const Json& volume) {
    const Json& box = At(volume, "box");
    for (int i = 0; i < 3; ++i) {
      centre[i] = NumberOf(At(box, static_cast<size_t>(i)));
      half[i] = NumberOf(At(box, 3 + 4 * static_cast<size_t>(i)));
    }
  }
  // Whether a box with this centre, of half sides `margin`, lies inside.
  bool Contains(Vec3d p, Vec3d margin) const {
    for (int i = 0; i < 3; ++i) {
      const double slack = kSlack * (std::abs(centre[i]) + half[i]);
      if (std::abs(p[i] - centre[i]) + margin[i] > half[i] + slack) return false;
    }
    return true;
  }
};

class TileVerifier {
 public:
  TileVerifier(const Surface& surface, std::string folder, CheckReport* report)
      : surface_(surface),
        folder_(std::move(folder)),
        report_(*report),
        placement_(surface.record(), std::nullopt),
        is_terrain_(IsTerrain(surface.record())) {}

  Status Run(const Json& record) {
    const Json& of = record["of"];
    if (of["digest"] != Json(surface_.record().digest_hex())) {
      Fail(kTileRecord, "the tiles are of another version of the object; write them anew");
      return Status::Ok();
    }
    report_.checks.push_back("tiles are of this version of " + surface_.record().name);
    try {
      const bool is_globe = of["format"] == Json("quantized-mesh");
      MTDB_RETURN_IF_ERROR(is_globe ? VerifyLayer() : VerifyTileset("tileset.json", nullptr));
    } catch (const UnexpectedJson& error) {
      Fail("a file of JSON", error.what());
    }
    uint64_t recorded = 0;
    for (const Json& level : RecordedLevels(record)) {
      if (const uint64_t* const tiles = level["tiles"].whole_number()) recorded += *tiles;
    }
    if (recorded != tiles_) {
      Fail(kTileRecord, "has " + std::to_string(recorded) + " tiles written, but the tree names " +
                            std::to_string(tiles_));
    }
    report_.checks.push_back(std::to_string(tiles_) +
                             " tiles are there, lie in their boxes, and "
                             "have falling errors");
    char line[160];
    std::snprintf(line, sizeof(line),
                  "%zu points of them are within what they state; the farthest at %.3f of it",
                  points_, largest_part_);
    report_.checks.emplace_back(line);
    return Status::Ok();
  }

 private:
  void Fail(const std::string& file, const std::string& what) {
    if (report_.failures.size() < kMostFailures) report_.failures.push_back(file + ": " + what);
  }

  // `above`: of the tile whose content the file is.
  Status VerifyTileset(const std::string& name, const Json* above) {
    if (!seen_.insert(name).second || seen_.size() > kMostTilesets) {
      Fail(name, "is a file of several tiles, or one of too many");
      return Status::Ok();
    }
    const Result<std::string> text = ContentOf(folder_, name);
    const Json tileset = text.ok() ? Json::ParseObject(*text) : Json();
    if (!tileset.is_object()) {
      Fail(name, "is not there, or no JSON");
      return Status::Ok();
    }
    return VerifyTile(At(tileset, "root"), above, name);
  }

  Status VerifyTile(const Json& tile, const Json* parent, const std::string& file) {
    const TileBox box(At(tile, "boundingVolume"));
    const double error = NumberOf(At(tile, "geometricError"));
    const std::string uri = tile.contains("content") ? TextOf(At(At(tile, "content"), "uri")) : "";
    const bool is_link = uri.ends_with(".json");
    if (parent != nullptr) {
      const bool same = parent->contains("content") &&
                        TextOf(At(At(*parent, "content"), "uri")).ends_with(".json");
      const double above = NumberOf(At(*parent, "geometricError"));
      if (same ? error != above : error >= above) {
        Fail(file, "an error of " + std::to_string(error) + " below one of " +
                       std::to_string(above) + " does not fall");
      }
      if (!TileBox(At(*parent, "boundingVolume")).Contains(box.centre, box.half)) {
        Fail(file, "a box reaches out of its parent's");
      }
    }
    const std::string path = std::filesystem::path(file).parent_path() / uri;
    if (is_link) {
      return VerifyTileset(std::filesystem::path(path).lexically_normal(), &tile);
    }
    if (!uri.empty()) {
      MTDB_RETURN_IF_ERROR(
          VerifyContent(std::filesystem::path(path).lexically_normal(), box,
                        NumberOf(At(At(At(tile, "metadata"), "properties"), "errorBound"))));
    }
    if (!tile.contains("children")) return Status::Ok();
    for (const Json& child : ElementsOf(At(tile, "children"))) {
      MTDB_RETURN_IF_ERROR(VerifyTile(child, &tile, file));
    }
    return Status::Ok();
  }

  Status VerifyContent(const std::string& name, const TileBox& box, double bound) {
    ++tiles_;
    const Result<std::string> bytes = ContentOf(folder_, name);
    const Result<GltfTile> tile =
        bytes.ok() ? DecodeGltfTile(AsBytes(*bytes)) : Result<GltfTile>(bytes.status());
    if (!tile.ok()) {
      Fail(name, tile.status().message());
      return Status::Ok();
    }
    if (tile->error_bound != bound) Fail(name, "states another bound than the tree");
    const auto position = [&](uint32_t v) {
      return tile->origin + ToDouble(tile->positions[v]) * tile->step;
    };
    for (uint32_t v = 0; v < tile->positions.size(); ++v) {
      if (!box.Contains(position(v), {})) {
        Fail(name, "a vertex lies outside of the tile's box");
        return Status::Ok();
      }
    }
    std::vector<Vec3d> points;
    const size_t step = std::max<size_t>(tile->surface_triangles / kPointsOfTile, 1);
    for (size_t t = 0; t < tile->surface_triangles; t += step) {
      const Vec3d middle = (position(tile->indices[3 * t]) + position(tile->indices[3 * t + 1]) +
                            position(tile->indices[3 * t + 2])) *
                           (1.0 / 3);
      points.push_back(placement_.Unplace(middle));
      if (AreCoordinates(points.back())) continue;
      Fail(name, "a point is beyond all coordinates");
      return Status::Ok();
    }
    return is_terrain_ ? MeasureHeights(name, points, bound, HalfStep(tile->step, box.centre))
                       : MeasureDistances(name, points, bound);
  }

  void Judge(const std::string& name, double distance, double bound) {
    ++points_;
    const double slack = kSlack * Diagonal(surface_.record().bounds) * placement_.metres();
    if (bound > slack) largest_part_ = std::max(largest_part_, distance / bound);
    if (distance <= bound + slack) return;
    Fail(name, "a point is " + std::to_string(distance) + " m off, but the tile states " +
                   std::to_string(bound));
  }

  Status MeasureDistances(const std::string& name, const std::vector<Vec3d>& points, double bound) {
    for (const Vec3d& p : points) {
      MTDB_ASSIGN_OR_RETURN(const ProbeAnswer answer, FindClosestPoint(surface_, p));
      if (answer.hit) Judge(name, answer.hit->distance * placement_.metres(), bound);
    }
    return Status::Ok();
  }

  // Of a lattice of `step` metres at a place of it, in the coordinates of the object.
  std::array<double, 2> HalfStep(double step, Vec3d place) const {
    const ObjectRecord& record = surface_.record();
    if (!IsInDegrees(record))
      return {step / 2 / placement_.metres(), step / 2 / placement_.metres()};
    constexpr double kMetresOfDegree = 111'000;  // a little less
    const double latitude = placement_.Unplace(place).y * std::numbers::pi / 180;
    return {step / 2 / (kMetresOfDegree * std::max(std::cos(latitude), 1e-3)),
            step / 2 / kMetresOfDegree};
  }

  // Where there is a height: a border may have moved. A tile's lattice puts its vertices up to
  // `near` beside where they were; so heights around count, too, where a cliff is.
  Status MeasureHeights(const std::string& name, const std::vector<Vec3d>& points, double bound,
                        std::array<double, 2> near) {
    for (const Vec3d& p : points) {
      MTDB_ASSIGN_OR_RETURN(double distance, HeightDistance(p, {0, 0}));
      for (int i = 0; i < 9 && distance * placement_.metres() > bound; ++i) {
        MTDB_ASSIGN_OR_RETURN(const double beside,
                              HeightDistance(p, {(i % 3 - 1) * near[0], (i / 3 - 1) * near[1]}));
        distance = std::min(distance, beside);
      }
      if (std::isfinite(distance)) Judge(name, distance * placement_.metres(), bound);
    }
    return Status::Ok();
  }

  // Infinite where there is no height. 0 where the surface passes the point between the two places.
  Result<double> HeightDistance(Vec3d p, std::array<double, 2> beside) {
    HeightCost cost;
    MTDB_ASSIGN_OR_RETURN(const std::vector<HeightAnswer> answers,
                          FindHeights(surface_,
                                      std::vector<std::array<double, 2>>{
                                          {p.x, p.y}, {p.x + beside[0], p.y + beside[1]}},
                                      {}, &cost));
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (const HeightAnswer& answer : answers) {
      if (!answer.height) continue;
      low = std::min(low, *answer.height);
      high = std::max(high, *answer.height);
    }
    if (low > high) return low;
    return std::max({low - p.z, p.z - high, 0.0});
  }

  Status VerifyLayer() {
    const Result<std::string> text = ContentOf(folder_, "layer.json");
    const Json layer = text.ok() ? Json::ParseObject(*text) : Json();
    if (!layer.is_object()) {
      Fail("layer.json", "is not there, or no JSON");
      return Status::Ok();
    }
    const bool mercator = At(layer, "projection") == Json("EPSG:3857");
    const Json& available = At(layer, "available");
    if (available.size() > kMostLevels) throw UnexpectedJson("expected at most 23 levels");
    double last = std::numeric_limits<double>::infinity();
    for (uint32_t level = 0; level < available.size(); ++level) {
      const double bound = NumberOf(At(At(layer, "errorBounds"), level));
      if (bound > last) Fail("layer.json", "the errors of levels do not fall");
      last = bound;
      const Json& range = At(At(available, level), 0);
      const uint64_t most = uint64_t{2} << level;  // of columns, and more than rows
      if (CountOf(At(range, "endX")) >= most || CountOf(At(range, "endY")) >= most) {
        throw UnexpectedJson("a level has more tiles than the globe");
      }
      for (uint64_t x = CountOf(At(range, "startX")); x <= CountOf(At(range, "endX")); ++x) {
        for (uint64_t y = CountOf(At(range, "startY")); y <= CountOf(At(range, "endY")); ++y) {
          MTDB_RETURN_IF_ERROR(VerifySquare(GlobeGrid(mercator), level, static_cast<uint32_t>(x),
                                            static_cast<uint32_t>(y), bound));
        }
      }
    }
    return Status::Ok();
  }

  Status VerifySquare(const GlobeGrid& grid, uint32_t level, uint32_t x, uint32_t y, double bound) {
    ++tiles_;
    const std::string name =
        std::to_string(level) + "/" + std::to_string(x) + "/" + std::to_string(y) + ".terrain";
    const Result<std::string> bytes = ContentOf(folder_, name);
    if (!bytes.ok()) {
      Fail(name, bytes.status().message());
      return Status::Ok();
    }
    const auto triangles = DecodeQuantizedTile(AsBytes(*bytes), grid.Rectangle(level, x, y));
    if (!triangles.ok()) {
      Fail(name, triangles.status().message());
      return Status::Ok();
    }
    const Box3d& data = surface_.record().bounds;
    std::vector<Vec3d> points;
    const size_t step = std::max<size_t>(triangles->size() / kPointsOfTile, 1);
    for (size_t t = 0; t < triangles->size(); t += step) {
      const Triangle3d& c = (*triangles)[t];
      const double twice =
          (c[1].x - c[0].x) * (c[2].y - c[0].y) - (c[2].x - c[0].x) * (c[1].y - c[0].y);
      Vec3d p = (c[0] + c[1] + c[2]) * (1.0 / 3);
      // Not walls, nor the ground beside the raster.
      const bool is_inside =
          p.x > data.min.x && p.x < data.max.x && p.y > data.min.y && p.y < data.max.y;
      if (!is_inside || !(twice > 0)) continue;
      p.z /= placement_.metres();
      if (!AreCoordinates(p)) continue;
      points.push_back(p);
    }
    const GlobeRectangle square = grid.Rectangle(level, x, y);
    return MeasureHeights(
        name, points, bound,
        {kHalfUnit * (square.east - square.west), kHalfUnit * (square.north - square.south)});
  }

  const Surface& surface_;
  const std::string folder_;
  CheckReport& report_;
  const TilePlacement placement_;
  const bool is_terrain_;
  size_t tiles_ = 0, points_ = 0;
  double largest_part_ = 0;
  std::set<std::string> seen_;  // tilesets
};

}  // namespace

Status VerifyTiles(const Surface& surface, const std::string& folder, CheckReport* report) {
  return CatchOutOfMemory([&]() -> Status {
    MTDB_ASSIGN_OR_RETURN(const Json record, ReadTileRecord(folder));
    return TileVerifier(surface, folder, report).Run(record);
  });
}

}  // namespace mtdb
