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
#include "tools/tiles/places/grid_range.h"
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
    const auto level = static_cast<uint32_t>(bounds_.size());
    const uint32_t multiple = MultipleOf(level);
    bounds_.push_back(stats.error_bound * metres_ + options_.coding.step * multiple / 2);
    range_ = RangeOf(level);
    return std::optional<uint32_t>(static_cast<uint32_t>(range_.count()));
  }

  void TilesOf(const Triangle3d& corners, std::vector<uint32_t>* tiles) const override {
    tiles->clear();
    Box3d box;
    for (const Vec3d& p : corners) box.Add(p);
    const auto level = static_cast<uint32_t>(bounds_.size()) - 1;
    const uint32_t x0 = grid_.Column(level, box.min.x), x1 = grid_.Column(level, box.max.x);
    const uint32_t y0 = RowOf(level, box.max.y), y1 = RowOf(level, box.min.y);
    for (uint32_t y = y0; y <= y1; ++y) {
      for (uint32_t x = x0; x <= x1; ++x) tiles->push_back(range_.NumberOf(x, y));
    }
  }

  Result<TileFile> Encode(TileId id, std::span<const LevelTriangle> triangles,
                          const LevelMesh& mesh) override {
    const auto [x, y] = RangeOf(id.level).PlaceOf(id.tile);
    const uint32_t multiple = MultipleOf(id.level);
    HeightGrid grid(id.level, x, y, options_.side);
    for (const LevelTriangle& t : triangles) grid.Add(mesh.Corners(t));
    std::vector<uint32_t> codes;
    codes.reserve(grid.heights().size());
    for (const double height : grid.heights()) {
      codes.push_back(std::isnan(height) ? options_.coding.CodeOf(0, 1)
                                         : options_.coding.CodeOf(height, multiple));
    }
    TileFile file;
    file.path = GridPath(id.level, x, y, ".png");
    file.triangles = triangles.size();
    MTDB_ASSIGN_OR_RETURN(file.bytes, EncodeHeightImage(codes, options_.side));
    return file;
  }

  std::optional<TileId> Find(std::string_view path) const override {
    const auto place = GridPlaceOf(path, ".png");
    if (!place || (*place)[0] >= bounds_.size()) return std::nullopt;
    const GridRange range = RangeOf((*place)[0]);
    if (!range.Contains((*place)[1], (*place)[2])) return std::nullopt;
    return TileId{(*place)[0], range.NumberOf((*place)[1], (*place)[2])};
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
  // Rows are from the north.
  uint32_t RowOf(uint32_t level, double latitude) const {
    return grid_.counts(level)[1] - 1 - grid_.Row(level, latitude);
  }
  GridRange RangeOf(uint32_t level) const {
    const Box3d& b = record_.bounds;
    return {grid_.Column(level, b.min.x), RowOf(level, b.max.y), grid_.Column(level, b.max.x),
            RowOf(level, b.min.y)};
  }
  // Heights of a level are multiples of so many steps of the coding.
  uint32_t MultipleOf(uint32_t level) const {
    uint32_t multiple = 1;
    const double room = (1 - kShareOfCut) * ErrorOf(level);
    while (multiple < 1u << 20 && options_.coding.step * multiple <= room) multiple *= 2;
    return multiple;
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
  GridRange range_;             // of the last of them
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
