// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "query/heights.h"
#include "store/base/coordinate_limit.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/three_d/gltf_tile.h"
#include "tools/tiles/verify/verifiers.h"

namespace mtdb {

namespace {

// Files that link to files, each of which is a call within a call.
constexpr size_t kMostTilesets = 10'000;

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
      const double slack = kJudgeSlack * (std::abs(centre[i]) + half[i]);
      if (std::abs(p[i] - centre[i]) + margin[i] > half[i] + slack) return false;
    }
    return true;
  }
};

class TilesetVerifier {
 public:
  TilesetVerifier(const TileFiles& files, TileJudge* judge) : files_(files), judge_(*judge) {}

  // `above`: of the tile whose content the file is.
  Status VerifyTileset(const std::string& name, const Json* above) {
    if (!seen_.insert(name).second || seen_.size() > kMostTilesets) {
      judge_.Fail(name, "is a file of several tiles, or one of too many");
      return Status::Ok();
    }
    const Result<std::string> text = files_.Read(name);
    const Json tileset = text.ok() ? Json::ParseObject(*text) : Json();
    if (!tileset.is_object()) {
      judge_.Fail(name, "is not there, or no JSON");
      return Status::Ok();
    }
    return VerifyTile(At(tileset, "root"), above, name);
  }

 private:
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
        judge_.Fail(file, "an error of " + std::to_string(error) + " below one of " +
                              std::to_string(above) + " does not fall");
      }
      if (!TileBox(At(*parent, "boundingVolume")).Contains(box.centre, box.half)) {
        judge_.Fail(file, "a box reaches out of its parent's");
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
    judge_.CountTile();
    const Result<std::string> bytes = files_.Read(name);
    const Result<GltfTile> tile =
        bytes.ok() ? DecodeGltfTile(AsBytes(*bytes)) : Result<GltfTile>(bytes.status());
    if (!tile.ok()) {
      judge_.Fail(name, tile.status().message());
      return Status::Ok();
    }
    if (tile->error_bound != bound) judge_.Fail(name, "states another bound than the tree");
    const auto position = [&](uint32_t v) {
      return tile->origin + ToDouble(tile->positions[v]) * tile->step;
    };
    for (uint32_t v = 0; v < tile->positions.size(); ++v) {
      if (!box.Contains(position(v), {})) {
        judge_.Fail(name, "a vertex lies outside of the tile's box");
        return Status::Ok();
      }
    }
    std::vector<Vec3d> points;
    const size_t step = std::max<size_t>(tile->surface_triangles / kPointsOfTile, 1);
    for (size_t t = 0; t < tile->surface_triangles; t += step) {
      const Vec3d middle = (position(tile->indices[3 * t]) + position(tile->indices[3 * t + 1]) +
                            position(tile->indices[3 * t + 2])) *
                           (1.0 / 3);
      points.push_back(judge_.placement().Unplace(middle));
      if (AreCoordinates(points.back())) continue;
      judge_.Fail(name, "a point is beyond all coordinates");
      return Status::Ok();
    }
    return IsTerrain(judge_.record())
               ? judge_.MeasureHeights(name, points, bound, HalfStep(tile->step, box.centre))
               : judge_.MeasureDistances(name, points, judge_.placement().metres(), bound);
  }

  // Of a lattice of `step` metres at a place of it, in the coordinates of the object.
  std::array<double, 2> HalfStep(double step, Vec3d place) const {
    const ObjectRecord& record = judge_.record();
    if (!IsInDegrees(record))
      return {step / 2 / judge_.placement().metres(), step / 2 / judge_.placement().metres()};
    constexpr double kMetresOfDegree = 111'000;  // a little less
    const double latitude = judge_.placement().Unplace(place).y * std::numbers::pi / 180;
    return {step / 2 / (kMetresOfDegree * std::max(std::cos(latitude), 1e-3)),
            step / 2 / kMetresOfDegree};
  }

  const TileFiles& files_;
  TileJudge& judge_;
  std::set<std::string> seen_;  // tilesets
};

}  // namespace

Status VerifyThreeDTiles(const TileFiles& files, TileJudge* judge) {
  return TilesetVerifier(files, judge).VerifyTileset("tileset.json", nullptr);
}

}  // namespace mtdb
