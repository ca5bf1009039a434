// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/quantized/quantized_mesh.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "tools/tiles/json_reading.h"
#include "tools/tiles/level/vertex_table.h"
#include "tools/tiles/places/geodesy.h"
#include "tools/tiles/places/geoid_range.h"
#include "tools/tiles/places/globe_grid.h"
#include "tools/tiles/places/grid_range.h"
#include "tools/tiles/places/terrain_clip.h"
#include "tools/tiles/places/tile_placement.h"
#include "tools/tiles/quantized/quantized_tile.h"

namespace mtdb {

namespace {

constexpr double kShareOfCut = 0.75, kShareOfBend = 0.2;  // the rest is for rounded heights
constexpr double kRowsOfTile = 64;
constexpr uint32_t kMostLevel = 22;
constexpr double kMostHeight = 1e6;  // metres; clients place tiles by spheres around the earth
constexpr double kFewUnits = 4;
constexpr size_t kFewTiles = 4;  // a box over more of them is larger than its triangle

// Height in a degree along x and in one along y, together; infinite of what stands upright.
double SlopeOf(const Triangle3d& c) {
  const Vec3d n = Cross(c[1] - c[0], c[2] - c[0]);
  return (std::abs(n.x) + std::abs(n.y)) / std::abs(n.z);
}

// How far heights, of `metres` a unit, are off because places become units of a tile: half of one
// is on a slope so much height, and no more than there is. Where the raster is hardly wider than
// units, ground of height 0 may take its place.
double ErrorOfUnits(const Box3d& b, double metres, double unit, double slope) {
  const double all = (std::max(b.max.z, 0.0) - std::min(b.min.z, 0.0)) * metres;
  const bool is_small = std::min(b.max.x - b.min.x, b.max.y - b.min.y) < kFewUnits * unit;
  const double error = slope * unit / 2;
  return is_small || !(error < all) ? all : error;
}

ClipVertex VertexOf(const LevelVertex& v) {
  const Vec3d n{v.normal.x, v.normal.y, v.normal.z};
  const double length = Length(n);
  const Vec3d unit = length > 0 ? n * (1 / length) : Vec3d{0, 0, 1};
  return {v.position, unit};
}

// Adds triangles that lie wholly within a tile of one piece as their polygons would be added, but
// looks at each vertex once.
class WholeTriangles {
 public:
  // Within `inner`: not at the raster's border either, where walls may hang.
  WholeTriangles(const LevelMesh& mesh, const GlobeRectangle& inner, size_t triangles,
                 QuantizedTile* tile)
      : mesh_(mesh), inner_(inner), known_(triangles / 2), tile_(tile) {}

  // False: the triangle is not one of these.
  bool Add(const LevelTriangle& t) {
    std::array<KnownVertex, 3> corners;
    for (size_t c = 0; c < 3; ++c) {
      corners[c] = Look(t[c]);
      if (!corners[c].is_within) return false;
    }
    const auto& [a, b, d] = corners;
    if (a.units == b.units || b.units == d.units || d.units == a.units) return true;
    std::array<uint32_t, 3> numbers{};
    for (size_t c = 0; c < 3; ++c) {
      numbers[c] = corners[c].number;
      if (numbers[c] != kNone32) continue;
      numbers[c] = tile_->NumberOf({corners[c].units, VertexOf(mesh_.vertex(t[c])).normal});
      known_.At(t[c]).number = numbers[c];
    }
    tile_->AddTriangle(numbers);
    return true;
  }

 private:
  struct KnownVertex {
    std::array<uint16_t, 3> units{};
    bool is_known = false, is_within = false;
    uint32_t number = kNone32;
  };

  const KnownVertex& Look(uint32_t v) {
    KnownVertex& vertex = known_.At(v);
    if (vertex.is_known) return vertex;
    const Vec3d p = mesh_.vertex(v).position;
    vertex.units = tile_->UnitsAt(p);
    vertex.is_known = true;
    vertex.is_within =
        p.x > inner_.west && p.x < inner_.east && p.y > inner_.south && p.y < inner_.north;
    return vertex;
  }

  const LevelMesh& mesh_;
  const GlobeRectangle inner_;
  VertexTable<KnownVertex> known_;
  QuantizedTile* tile_;
};

class QuantizedMesh final : public TileFormat {
 public:
  QuantizedMesh(const ObjectRecord& record, const QuantizedMeshOptions& options)
      : record_(record), grid_(options.mercator), metres_(MetresOf(record)) {
    const Box3d& b = record.bounds;
    data_ = {b.min.x, b.min.y, b.max.x, b.max.y};
    max_level_ = options.max_level.value_or(LevelOfRaster());
  }

  std::string_view name() const override { return "quantized-mesh"; }
  Vec3d Place(Vec3d p) const override { return {p.x, p.y, p.z * metres_}; }
  Vec3d MetresAt(Vec3d p) const override {
    const double degree = kEarthRadius * kRadOfDegree;
    return {degree * std::cos(p.y * kRadOfDegree), degree, 1};
  }

  std::optional<Query> NextLevel() override {
    if (bounds_.size() > max_level_) return std::nullopt;
    Query query;
    const double error = grid_.error(static_cast<uint32_t>(bounds_.size()));
    query.threshold = ConstantThreshold(kShareOfCut * error / metres_);
    return query;
  }

  Result<std::optional<uint32_t>> Plan(const LevelMesh& mesh, const ExtractStats& stats) override {
    const auto number = static_cast<uint32_t>(bounds_.size());
    const auto [columns, rows] = grid_.counts(number);
    Level level;
    level.range = {grid_.Column(number, data_.west), grid_.Row(number, data_.south),
                   grid_.Column(number, data_.east), grid_.Row(number, data_.north)};
    if (number == 0) level.range = {0, 0, columns - 1, rows - 1};  // clients ask for all of them
    level.parts = PartsOf(number);
    levels_.push_back(std::move(level));
    last_ = {};
    double steepest = 0;
    MTDB_RETURN_IF_ERROR(FindHeights(mesh, &steepest));
    bounds_.push_back(
        stats.error_bound * metres_ + BendOf(number, levels_.back().parts) +
        levels_.back().height_step / 2 +
        ErrorOfUnits(record_.bounds, metres_, grid_.side(number) / kTileUnits, steepest));
    return std::optional<uint32_t>(static_cast<uint32_t>(levels_.back().range.count()));
  }

  void TilesOf(const Triangle3d& c, std::vector<uint32_t>* tiles) const override {
    tiles->clear();
    Box3d box;
    for (const Vec3d& p : c) box.Add(p);
    if (last_.Has(box)) {
      tiles->push_back(last_.tile);
      return;
    }
    const auto level = static_cast<uint32_t>(levels_.size()) - 1;
    const uint32_t x0 = grid_.Column(level, box.min.x), x1 = grid_.Column(level, box.max.x);
    const uint32_t y0 = grid_.Row(level, box.min.y), y1 = grid_.Row(level, box.max.y);
    const bool is_large = (x1 - x0 + size_t{1}) * (y1 - y0 + size_t{1}) > kFewTiles;
    for (uint32_t y = y0; y <= y1; ++y) {
      for (uint32_t x = x0; x <= x1; ++x) {
        if (is_large) {
          const GlobeRectangle r = grid_.Rectangle(level, x, y);
          const Box3d tile{{r.west, r.south, box.min.z - 1}, {r.east, r.north, box.max.z + 1}};
          if (!TriangleMeetsBox(c, tile)) continue;
        }
        tiles->push_back(levels_.back().range.NumberOf(x, y));
      }
    }
    if (tiles->size() == 1) last_ = {grid_.Rectangle(level, x0, y0), tiles->front()};
  }

  Result<TileFile> Encode(TileId id, std::span<const LevelTriangle> triangles,
                          const LevelMesh& mesh) override {
    const Level& level = levels_[id.level];
    const auto [x, y] = level.range.PlaceOf(id.tile);
    const GlobeRectangle rectangle = grid_.Rectangle(id.level, x, y);
    const auto [low, high] = HeightsOf(id);
    const double step = level.height_step;
    QuantizedTile quantized(rectangle, std::floor(low / step) * step, step);
    const std::vector<double> meridians = Lines(rectangle.west, rectangle.east, level.parts);
    const std::vector<double> parallels = Lines(rectangle.south, rectangle.north, level.parts);
    WholeTriangles whole(mesh, Inner(rectangle), triangles.size(), &quantized);
    for (const LevelTriangle& t : triangles) {
      if (level.parts == 1 && whole.Add(t)) continue;
      ClipPolygon polygon;
      for (const uint32_t v : t) polygon.Add(VertexOf(mesh.vertex(v)));
      AddPieces(polygon, meridians, parallels, &quantized);
    }
    AddGround(rectangle, meridians, parallels, &quantized);
    TileFile file;
    file.path = GridPath(id.level, x, y, ".terrain");
    file.triangles = quantized.triangle_count();
    file.bytes = quantized.Encode();
    return file;
  }

  std::optional<TileId> Find(std::string_view path) const override {
    const auto place = GridPlaceOf(path, ".terrain");
    if (!place || (*place)[0] >= levels_.size()) return std::nullopt;
    const GridRange& range = levels_[(*place)[0]].range;
    if (!range.Contains((*place)[1], (*place)[2])) return std::nullopt;
    return TileId{(*place)[0], range.NumberOf((*place)[1], (*place)[2])};
  }

  TileLevel EndLevel() override {
    TileLevel level;
    level.error_bound = bounds_.back();
    return level;
  }

  Result<std::vector<std::pair<std::string, std::string>>> Finish() override {
    Json available(Json::Array{});
    for (const Level& level : levels_) {
      const GridRange& r = level.range;
      available.push_back(Json(Json::Array{Json{{"startX", r.first_column},
                                                {"startY", r.first_row},
                                                {"endX", r.last_column},
                                                {"endY", r.last_row}}}));
    }
    // A coarser level may be less steep, and is not told to be better for it.
    std::vector<double> bounds = bounds_;
    for (size_t i = bounds.size(); i-- > 1;) bounds[i - 1] = std::max(bounds[i - 1], bounds[i]);
    const std::string warning = HeightWarning(record_);
    Json layer = {{"tilejson", "2.1.0"},
                  {"name", record_.name},
                  {"version", "1.1.0"},
                  {"format", "quantized-mesh-1.0"},
                  {"scheme", "tms"},
                  {"projection", grid_.mercator() ? "EPSG:3857" : "EPSG:4326"},
                  {"tiles", {"{z}/{x}/{y}.terrain?v=" + record_.digest_hex()}},
                  {"bounds", {data_.west, data_.south, data_.east, data_.north}},
                  {"minzoom", 0},
                  {"maxzoom", max_level_},
                  {"extensions", {"octvertexnormals"}},
                  {"available", available},
                  {"description", warning},
                  {"errorBounds", bounds}};
    return std::vector<std::pair<std::string, std::string>>{{"layer.json", layer.Text() + "\n"}};
  }

  Json State() const override {
    Json ranges(Json::Array{});
    for (const Level& level : levels_) {
      const GridRange& r = level.range;
      ranges.push_back(Json(Json::Array{r.first_column, r.first_row, r.last_column, r.last_row}));
    }
    return {{"bounds", bounds_}, {"ranges", std::move(ranges)}};
  }
  bool Restore(const Json& state, size_t levels) override {
    for (const Json& bound : ElementsOf(At(state, "bounds"))) bounds_.push_back(NumberOf(bound));
    for (const Json& r : ElementsOf(At(state, "ranges"))) {
      const auto number = [&](size_t i) { return static_cast<uint32_t>(CountOf(At(r, i))); };
      levels_.emplace_back().range = {number(0), number(1), number(2), number(3)};
    }
    return bounds_.size() == levels && levels_.size() == levels;
  }

 private:
  struct Heights {
    double low = 0, high = 0;
    bool known = false;
    void Add(double l, double h) {
      low = known ? std::min(low, l) : l;
      high = known ? std::max(high, h) : h;
      known = true;
    }
  };
  // Where the last triangle was alone in a tile: most are near the one before.
  struct LastTile {
    GlobeRectangle rectangle;
    uint32_t tile = 0;
    bool Has(const Box3d& box) const {
      return box.min.x > rectangle.west && box.max.x < rectangle.east &&
             box.min.y > rectangle.south && box.max.y < rectangle.north;
    }
  };
  // Of a level that an earlier run wrote only the range is known.
  struct Level {
    GridRange range;
    uint32_t parts = 1;  // that tiles are cut into each way
    double height_step = 1;
    std::vector<Heights> heights;  // of the tiles
  };

  uint32_t LevelOfRaster() const {
    const std::array<double, 6>& g = record_.raster->geotransform;
    const double row = std::max(std::abs(g[5]), 1e-9) * kRowsOfTile;
    const double level = std::ceil(std::log2(grid_.side(0) / row) - 1e-6);
    return static_cast<uint32_t>(std::clamp(level, 0.0, double{kMostLevel}));
  }

  // How far a piece of a plane triangle is at most from where it belongs on the globe, when tiles
  // are cut into so many parts each way: second derivatives of the ellipsoid are its curvature, and
  // along a parallel tan(latitude) times more of what the cosine has made shorter.
  double BendOf(uint32_t level, uint32_t parts) const {
    constexpr double kOfBothAxes = 1 + 1.2072, kOfTriangle = 1.0 / 6;
    const double part = grid_.side(level) * kRadOfDegree / parts;
    return kEarthRadius * kOfTriangle * kOfBothAxes * part * part;
  }
  uint32_t PartsOf(uint32_t level) const {
    uint32_t parts = 1;
    while (BendOf(level, parts) > kShareOfBend * grid_.error(level)) parts *= 2;
    return parts;
  }
  static std::vector<double> Lines(double low, double high, uint32_t parts) {
    std::vector<double> lines;
    for (uint32_t i = 0; i <= parts; ++i) {
      lines.push_back(i == parts ? high : low + (high - low) * i / parts);
    }
    return lines;
  }

  // The least and largest height of each tile, and of them the level's step: a power of two metres.
  Status FindHeights(const LevelMesh& mesh, double* steepest) {
    Level& level = levels_.back();
    level.heights.assign(level.range.count(), {0, 0, false});
    std::vector<uint32_t> tiles;
    MTDB_RETURN_IF_ERROR(mesh.Visit([&](std::span<const LevelTriangle> triangles) {
      for (const LevelTriangle& t : triangles) {
        const Triangle3d c = mesh.Corners(t);
        const auto [low, high] = std::minmax({c[0].z, c[1].z, c[2].z});
        TilesOf(c, &tiles);
        for (const uint32_t tile : tiles) level.heights[tile].Add(low, high);
        *steepest = std::max(*steepest, SlopeOf(c));
      }
      return Status::Ok();
    }));
    double most = 0;
    const auto number = static_cast<uint32_t>(levels_.size()) - 1;
    for (uint32_t tile = 0; tile < level.heights.size(); ++tile) {
      const auto [low, high] = HeightsOf({number, tile});
      most = std::max(most, high - low);
    }
    level.height_step = std::exp2(std::ceil(std::log2(std::max(most, 1.0) / (kTileUnits - 2))));
    return Status::Ok();
  }

  // Where the tile has samples all around.
  GlobeRectangle Inner(const GlobeRectangle& r) const {
    return {std::max(r.west, data_.west), std::max(r.south, data_.south),
            std::min(r.east, data_.east), std::min(r.north, data_.north)};
  }
  bool IsPartlyCovered(const GlobeRectangle& r) const {
    return r.west < data_.west || r.south < data_.south || r.east > data_.east ||
           r.north > data_.north;
  }
  std::pair<double, double> HeightsOf(TileId id) const {
    const Heights& h = levels_[id.level].heights[id.tile];
    const auto [x, y] = levels_[id.level].range.PlaceOf(id.tile);
    const GlobeRectangle r = grid_.Rectangle(id.level, x, y);
    if (!IsPartlyCovered(r)) return {h.low, h.high};
    return {std::min(h.low, 0.0), std::max(h.high, 0.0)};
  }

  static size_t FirstPart(const std::vector<double>& lines, double at) {
    const auto above = std::upper_bound(lines.begin() + 1, lines.end() - 1, at);
    return static_cast<size_t>(above - lines.begin()) - 1;
  }

  void AddPieces(const ClipPolygon& triangle, const std::vector<double>& meridians,
                 const std::vector<double>& parallels, QuantizedTile* tile) const {
    Box3d box;
    for (size_t i = 0; i < triangle.count; ++i) box.Add(triangle.corners[i].position);
    for (size_t i = FirstPart(meridians, box.min.x);
         i + 1 < meridians.size() && meridians[i] <= box.max.x; ++i) {
      const ClipPolygon strip = ClipBetween(triangle, 0, meridians[i], meridians[i + 1]);
      for (size_t j = FirstPart(parallels, box.min.y);
           j + 1 < parallels.size() && parallels[j] <= box.max.y; ++j) {
        const ClipPolygon piece = ClipBetween(strip, 1, parallels[j], parallels[j + 1]);
        tile->Add(piece);
        AddWalls(piece, meridians, parallels, tile);
      }
    }
  }

  // Below edges on the raster's border, where ground goes on beyond it.
  void AddWalls(const ClipPolygon& piece, const std::vector<double>& meridians,
                const std::vector<double>& parallels, QuantizedTile* tile) const {
    const auto on_border = [&](Vec3d a, Vec3d b) {
      const auto on = [](double p, double q, double line, double first, double last) {
        return p == line && q == line && line > first && line < last;
      };
      return on(a.x, b.x, data_.west, meridians.front(), meridians.back()) ||
             on(a.x, b.x, data_.east, meridians.front(), meridians.back()) ||
             on(a.y, b.y, data_.south, parallels.front(), parallels.back()) ||
             on(a.y, b.y, data_.north, parallels.front(), parallels.back());
    };
    for (size_t i = 0; i < piece.count; ++i) {
      const ClipVertex& a = piece.corners[i];
      const ClipVertex& b = piece.corners[(i + 1) % piece.count];
      if (!on_border(a.position, b.position)) continue;
      ClipPolygon wall;
      for (const ClipVertex& v : {b, a}) wall.Add(v);
      for (ClipVertex v : {a, b}) {
        v.position.z = 0;
        wall.Add(v);
      }
      tile->Add(wall);
    }
  }

  // Height 0 around the raster.
  void AddGround(const GlobeRectangle& r, std::vector<double> meridians,
                 std::vector<double> parallels, QuantizedTile* tile) const {
    if (!IsPartlyCovered(r)) return;
    const auto add = [](std::vector<double>* lines, double line) {
      if (line > lines->front() && line < lines->back()) {
        lines->insert(std::lower_bound(lines->begin(), lines->end(), line), line);
      }
    };
    add(&meridians, data_.west);
    add(&meridians, data_.east);
    add(&parallels, data_.south);
    add(&parallels, data_.north);
    for (size_t i = 0; i + 1 < meridians.size(); ++i) {
      for (size_t j = 0; j + 1 < parallels.size(); ++j) {
        const double x0 = meridians[i], x1 = meridians[i + 1], y0 = parallels[j],
                     y1 = parallels[j + 1];
        const bool is_covered =
            x0 >= data_.west && x1 <= data_.east && y0 >= data_.south && y1 <= data_.north;
        if (is_covered) continue;
        ClipPolygon cell;
        for (const Vec3d p : {Vec3d{x0, y0, 0}, {x1, y0, 0}, {x1, y1, 0}, {x0, y1, 0}}) {
          cell.Add({p, {0, 0, 1}});
        }
        tile->Add(cell);
      }
    }
  }

  const ObjectRecord record_;
  const GlobeGrid grid_;
  const double metres_;  // of a unit of height
  GlobeRectangle data_;
  uint32_t max_level_ = 0;
  // Of the levels so far.
  std::vector<double> bounds_;
  std::vector<Level> levels_;
  mutable LastTile last_;  // of the last level
};

}  // namespace

std::string HeightWarning(const ObjectRecord& record) {
  const std::string datum = record.raster ? record.raster->vertical_datum : "";
  // As a datum, or as the third axis of a geographic system.
  const bool ellipsoidal = datum.find("llipsoid") != std::string::npos ||
                           record.georeference.find("CS[ellipsoidal,3]") != std::string::npos;
  if (ellipsoidal) return "";
  const Box3d& b = record.bounds;
  const GeoidRange geoid = GeoidOver({b.min.x, b.min.y, b.max.x, b.max.y});
  return "heights are written as if they were above the ellipsoid of WGS 84, but the raster " +
         (datum.empty() ? std::string("does not say what they are above")
                        : "has them above " + datum) +
         "; heights above the sea are off by the geoid, which is " + std::to_string(geoid.low) +
         " to " + std::to_string(geoid.high) +
         " m high there (EGM96); 'gdalwarp -s_srs EPSG:4326+5773 -t_srs EPSG:4979' makes a raster "
         "of heights above the ellipsoid of such a one, to ingest anew";
}

Result<std::unique_ptr<TileFormat>> MakeQuantizedMesh(const ObjectRecord& record,
                                                      const QuantizedMeshOptions& options) {
  const std::string name = record.name + ": ";
  if (!record.raster) {
    return InvalidArgument(name +
                           "quantized-mesh is for terrains that were rasters in degrees; --as "
                           "3dtiles --at LON,LAT,HEIGHT puts any object on the globe");
  }
  if (!IsInDegrees(record)) {
    return InvalidArgument(
        name +
        "the terrain is not in degrees of longitude and latitude; 'gdalwarp -t_srs "
        "EPSG:4326' makes a raster that is, to ingest anew");
  }
  const Box3d& b = record.bounds;
  const double latitude = options.mercator ? kMercatorLatitude : 90;
  if (b.min.x < -180 || b.max.x > 180 || b.min.y < -latitude || b.max.y > latitude) {
    return InvalidArgument(name +
                           "the terrain reaches beyond what tiles cover: longitudes -180 to "
                           "180, latitudes " +
                           (options.mercator ? "-85.05 to 85.05" : "-90 to 90"));
  }
  const double metres = MetresOf(record);
  if (b.min.z * metres < -kMostHeight || b.max.z * metres > kMostHeight) {
    char line[200];
    std::snprintf(
        line, sizeof(line),
        "heights are from %.6g to %.6g m, but clients of quantized-mesh take -1e6 to 1e6 m "
        "from the ellipsoid; ingest the raster in other units of height",
        b.min.z * metres, b.max.z * metres);
    return InvalidArgument(name + line);
  }
  return std::unique_ptr<TileFormat>(std::make_unique<QuantizedMesh>(record, options));
}

}  // namespace mtdb
