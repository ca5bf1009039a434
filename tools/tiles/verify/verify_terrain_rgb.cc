// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tools/tiles/json_reading.h"
#include "tools/tiles/places/globe_grid.h"
#include "tools/tiles/terrain_rgb/height_grid.h"
#include "tools/tiles/terrain_rgb/height_image.h"
#include "tools/tiles/verify/verifiers.h"

namespace mtdb {

namespace {

constexpr uint32_t kMostLevels = 23;
constexpr uint32_t kStride = 7919;  // from one measured pixel to the next: a prime

class PictureVerifier {
 public:
  PictureVerifier(const TileFiles& files, TileJudge* judge) : files_(files), judge_(*judge) {}

  Status Run() {
    const Result<std::string> text = files_.Read("tiles.json");
    const Json tiles = text.ok() ? Json::ParseObject(*text) : Json();
    coding_ = At(tiles, "encoding") == Json("mapbox") ? kMapbox : kTerrarium;
    const uint64_t side = CountOf(At(tiles, "tileSize"));
    if (side != 256 && side != 512) throw UnexpectedJson("expected a tileSize of 256 or 512");
    side_ = static_cast<uint32_t>(side);
    const Json& bounds = At(tiles, "errorBounds");
    if (bounds.size() > kMostLevels) throw UnexpectedJson("expected at most 23 levels");
    if (CountOf(At(tiles, "maxzoom")) + 1 != bounds.size()) {
      throw UnexpectedJson("expected a bound for each level");
    }
    double last = std::numeric_limits<double>::infinity();
    for (uint32_t level = 0; level < bounds.size(); ++level) {
      const double bound = NumberOf(At(bounds, level));
      if (bound > last) judge_.Fail("tiles.json", "the errors of levels do not fall");
      last = bound;
      MTDB_RETURN_IF_ERROR(VerifyLevel(level, bound));
    }
    return Status::Ok();
  }

 private:
  Status VerifyLevel(uint32_t level, double bound) {
    const GlobeGrid grid(true);
    const Box3d& b = judge_.record().bounds;
    const uint32_t last_row = grid.counts(level)[1] - 1;
    for (uint32_t x = grid.Column(level, b.min.x); x <= grid.Column(level, b.max.x); ++x) {
      for (uint32_t y = last_row - grid.Row(level, b.max.y);
           y <= last_row - grid.Row(level, b.min.y); ++y) {
        if (judge_.HasEnough()) return Status::Ok();
        MTDB_RETURN_IF_ERROR(VerifyTile(level, x, y, bound));
      }
    }
    return Status::Ok();
  }

  Status VerifyTile(uint32_t level, uint32_t x, uint32_t y, double bound) {
    judge_.CountTile();
    const std::string name =
        std::to_string(level) + "/" + std::to_string(x) + "/" + std::to_string(y) + ".png";
    const Result<std::string> bytes = files_.Read(name);
    const auto codes = bytes.ok() ? DecodeHeightImage(AsBytes(*bytes), side_)
                                  : Result<std::vector<uint32_t>>(bytes.status());
    if (!codes.ok()) {
      judge_.Fail(name, codes.status().message());
      return Status::Ok();
    }
    const HeightGrid grid(level, x, y, side_);
    const Box3d& b = judge_.record().bounds;
    std::vector<Vec3d> points;
    uint32_t at = kStride % (side_ * side_);
    for (uint32_t i = 0; i < side_ * side_ && points.size() < kPointsOfTile; ++i) {
      at = (at + kStride) % (side_ * side_);
      const double longitude = grid.longitude(at % side_), latitude = grid.latitude(at / side_);
      const bool is_inside =
          longitude > b.min.x && longitude < b.max.x && latitude > b.min.y && latitude < b.max.y;
      if (!is_inside || IsNone((*codes)[at])) continue;
      points.push_back(
          {longitude, latitude, coding_.HeightOf((*codes)[at]) / judge_.placement().metres()});
    }
    return judge_.MeasureHeights(name, points, bound, {0, 0});
  }

  // A terrain with holes has 0 in them, and a little beside them where its border may move.
  bool IsNone(uint32_t code) const {
    return judge_.record().boundary_loops > 1 && std::abs(coding_.HeightOf(code)) < coding_.step;
  }

  const TileFiles& files_;
  TileJudge& judge_;
  HeightCoding coding_ = kTerrarium;
  uint32_t side_ = 256;
};

}  // namespace

Status VerifyTerrainRgb(const TileFiles& files, TileJudge* judge) {
  return PictureVerifier(files, judge).Run();
}

}  // namespace mtdb
