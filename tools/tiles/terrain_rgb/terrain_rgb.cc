// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/terrain_rgb/terrain_rgb.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>
#include <vector>

#include "tools/tiles/json_reading.h"
#include "tools/tiles/places/globe_grid.h"
#include "tools/tiles/places/tile_placement.h"
#include "tools/tiles/terrain_rgb/height_grid.h"

namespace mtdb {

namespace {

constexpr double kShareOfCut = 0.75;  // the rest is for rounding
constexpr uint32_t kMostLevel = 22;

class TerrainRgb final : public TileFormat {
 public:
  TerrainRgb(const ObjectRecord& record, const TerrainRgbOptions& options)
      : record_(record), options_(options), metres_(MetresOf(record)) {
    max_level_ = options.max_level.value_or(LevelOfRaster());
  }

  std::string_view name() const override { return "terrain-rgb"; }
  bool has_normals() const override { return false; }
  Vec3d Place(Vec3d p) const override { return {p.x, p.y, p.z * metres_}; }

  std::optional<Query> NextLevel() override {
    if (bounds_.size() > max_level_) return std::nullopt;
    Query query;
    query.threshold =
        ConstantThreshold(kShareOfCut * ErrorOf(static_cast<uint32_t>(bounds_.size())) / metres_);
    return query;
  }

  Result<std::optional<uint32_t>> Plan(const LevelMesh&, const ExtractStats& stats) override {
    level_ = static_cast<uint32_t>(bounds_.size());
    const Box3d& b = record_.bounds;
    // Rows are from the north.
    range_ = {grid_.Column(level_, b.min.x), RowOf(b.max.y), grid_.Column(level_, b.max.x),
              RowOf(b.min.y)};
    multiple_ = 1;
    const double room = (1 - kShareOfCut) * ErrorOf(level_);
    while (multiple_ < 1u << 20 && options_.coding.step * multiple_ <= room) multiple_ *= 2;
    bounds_.push_back(stats.error_bound * metres_ + options_.coding.step * multiple_ / 2);
    return std::optional<uint32_t>(
        static_cast<uint32_t>(width() * (uint64_t{range_[3]} - range_[1] + 1)));
  }

  void TilesOf(const Triangle3d& corners, std::vector<uint32_t>* tiles) const override {
    tiles->clear();
    Box3d box;
    for (const Vec3d& p : corners) box.Add(p);
    const uint32_t x0 = grid_.Column(level_, box.min.x), x1 = grid_.Column(level_, box.max.x);
    const uint32_t y0 = RowOf(box.max.y), y1 = RowOf(box.min.y);
    for (uint32_t y = y0; y <= y1; ++y) {
      for (uint32_t x = x0; x <= x1; ++x) {
        tiles->push_back((y - range_[1]) * width() + x - range_[0]);
      }
    }
  }

  Result<TileFile> Encode(uint32_t tile, std::span<const LevelTriangle> triangles,
                          const LevelMesh& mesh) override {
    const uint32_t x = range_[0] + tile % width(), y = range_[1] + tile / width();
    HeightGrid grid(level_, x, y, options_.side);
    for (const LevelTriangle& t : triangles) grid.Add(mesh.Corners(t));
    std::vector<uint32_t> codes;
    codes.reserve(grid.heights().size());
    for (const double height : grid.heights()) {
      codes.push_back(std::isnan(height) ? options_.coding.CodeOf(0, 1)
                                         : options_.coding.CodeOf(height, multiple_));
    }
    TileFile file;
    file.path = std::to_string(level_) + "/" + std::to_string(x) + "/" + std::to_string(y) + ".png";
    file.triangles = triangles.size();
    MTDB_ASSIGN_OR_RETURN(file.bytes, EncodeHeightImage(codes, options_.side));
    return file;
  }

  TileLevel EndLevel() override {
    TileLevel level;
    level.error_bound = bounds_.back();
    return level;
  }

  Result<std::vector<std::pair<std::string, std::string>>> Finish() override {
    const Box3d& b = record_.bounds;
    const Json tiles = {{"tilejson", "3.0.0"},
                        {"name", record_.name},
                        {"version", "1.0.0"},
                        {"scheme", "xyz"},
                        {"tiles", {"{z}/{x}/{y}.png?v=" + record_.digest_hex()}},
                        {"encoding", options_.coding.name},
                        {"tileSize", options_.side},
                        {"bounds", {b.min.x, b.min.y, b.max.x, b.max.y}},
                        {"minzoom", 0},
                        {"maxzoom", max_level_},
                        {"errorBounds", bounds_}};
    return std::vector<std::pair<std::string, std::string>>{{"tiles.json", tiles.Text() + "\n"}};
  }

  Json State() const override { return {{"bounds", bounds_}}; }
  bool Restore(const Json& state, size_t levels) override {
    for (const Json& bound : ElementsOf(At(state, "bounds"))) bounds_.push_back(NumberOf(bound));
    return bounds_.size() == levels;
  }

 private:
  using Range = std::array<uint32_t, 4>;  // the first column and row, the last column and row

  uint32_t width() const { return range_[2] - range_[0] + 1; }
  uint32_t RowOf(double latitude) const {
    return grid_.counts(level_)[1] - 1 - grid_.Row(level_, latitude);
  }
  double ErrorOf(uint32_t level) const {
    const double pixel = 2 * std::numbers::pi * kEarthRadius / options_.side;
    return std::ldexp(pixel * kErrorOfPixel, -static_cast<int>(level));
  }
  uint32_t LevelOfRaster() const {
    const std::array<double, 6>& g = record_.raster->geotransform;
    const double tile = std::max(std::abs(g[1]), 1e-9) * options_.side;
    const double level = std::ceil(std::log2(360 / tile) - 1e-6);
    return static_cast<uint32_t>(std::clamp(level, 0.0, double{kMostLevel}));
  }

  const ObjectRecord record_;
  const TerrainRgbOptions options_;
  const double metres_;  // of a unit of height
  const GlobeGrid grid_{true};
  uint32_t max_level_ = 0;
  std::vector<double> bounds_;  // of the levels so far
  // Of the level that is written.
  uint32_t level_ = 0, multiple_ = 1;
  Range range_{};
};

}  // namespace

Result<std::unique_ptr<TileFormat>> MakeTerrainRgb(const ObjectRecord& record,
                                                   const TerrainRgbOptions& options) {
  const std::string name = record.name + ": ";
  if (!record.raster || !IsInDegrees(record)) {
    return InvalidArgument(name +
                           "terrain-rgb is for terrains that were rasters in degrees; 'gdalwarp "
                           "-t_srs EPSG:4326' makes such a raster, to ingest anew");
  }
  const Box3d& b = record.bounds;
  if (b.min.x < -180 || b.max.x > 180 || b.min.y < -kMercatorLatitude ||
      b.max.y > kMercatorLatitude) {
    return InvalidArgument(name +
                           "the terrain reaches beyond Web Mercator: longitudes -180 to 180, "
                           "latitudes -85.05 to 85.05");
  }
  const double metres = MetresOf(record);
  if (b.min.z * metres < options.coding.least || b.max.z * metres > options.coding.most()) {
    char line[200];
    std::snprintf(line, sizeof(line), "heights are from %.6g to %.6g m, but %s has %.6g to %.6g m",
                  b.min.z * metres, b.max.z * metres, options.coding.name, options.coding.least,
                  options.coding.most());
    return InvalidArgument(name + line);
  }
  return std::unique_ptr<TileFormat>(std::make_unique<TerrainRgb>(record, options));
}

}  // namespace mtdb
