// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "store/base/coordinate_limit.h"
#include "tools/tiles/json_reading.h"
#include "tools/tiles/places/globe_grid.h"
#include "tools/tiles/quantized/quantized_tile.h"
#include "tools/tiles/verify/verifiers.h"

namespace mtdb {

namespace {

constexpr size_t kMostLevels = 23;

class LayerVerifier {
 public:
  LayerVerifier(const TileFiles& files, TileJudge* judge) : files_(files), judge_(*judge) {}

  Status VerifyLayer() {
    const Result<std::string> text = files_.Read("layer.json");
    const Json layer = text.ok() ? Json::ParseObject(*text) : Json();
    if (!layer.is_object()) {
      judge_.Fail("layer.json", "is not there, or no JSON");
      return Status::Ok();
    }
    const bool mercator = At(layer, "projection") == Json("EPSG:3857");
    const Json& available = At(layer, "available");
    if (available.size() > kMostLevels) throw UnexpectedJson("expected at most 23 levels");
    double last = std::numeric_limits<double>::infinity();
    for (uint32_t level = 0; level < available.size(); ++level) {
      const double bound = NumberOf(At(At(layer, "errorBounds"), level));
      if (bound > last) judge_.Fail("layer.json", "the errors of levels do not fall");
      last = bound;
      const Json& range = At(At(available, level), 0);
      const uint64_t most = uint64_t{2} << level;  // of columns, and more than rows
      if (CountOf(At(range, "endX")) >= most || CountOf(At(range, "endY")) >= most) {
        throw UnexpectedJson("a level has more tiles than the globe");
      }
      for (uint64_t x = CountOf(At(range, "startX")); x <= CountOf(At(range, "endX")); ++x) {
        for (uint64_t y = CountOf(At(range, "startY")); y <= CountOf(At(range, "endY")); ++y) {
          if (judge_.HasEnough()) return Status::Ok();
          MTDB_RETURN_IF_ERROR(VerifySquare(GlobeGrid(mercator), level, static_cast<uint32_t>(x),
                                            static_cast<uint32_t>(y), bound));
        }
      }
    }
    return Status::Ok();
  }

 private:
  Status VerifySquare(const GlobeGrid& grid, uint32_t level, uint32_t x, uint32_t y, double bound) {
    judge_.CountTile();
    const std::string name =
        std::to_string(level) + "/" + std::to_string(x) + "/" + std::to_string(y) + ".terrain";
    const Result<std::string> bytes = files_.Read(name);
    if (!bytes.ok()) {
      judge_.Fail(name, bytes.status().message());
      return Status::Ok();
    }
    const auto triangles = DecodeQuantizedTile(AsBytes(*bytes), grid.Rectangle(level, x, y));
    if (!triangles.ok()) {
      judge_.Fail(name, triangles.status().message());
      return Status::Ok();
    }
    const Box3d& data = judge_.record().bounds;
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
      p.z /= judge_.placement().metres();
      if (!AreCoordinates(p)) continue;
      points.push_back(p);
    }
    return judge_.MeasureHeights(name, points, bound, {0, 0});
  }

  const TileFiles& files_;
  TileJudge& judge_;
};

}  // namespace

Status VerifyQuantizedMesh(const TileFiles& files, TileJudge* judge) {
  return LayerVerifier(files, judge).VerifyLayer();
}

}  // namespace mtdb
