// SPDX-License-Identifier: Apache-2.0
// What `mtdb tile --as quantized-mesh` writes, read as clients do.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>

#include "tests/tiles/tile_reading.h"
#include "tools/tiles/places/geoid_range.h"

namespace mtdb::test {
namespace {

constexpr double kRadius = 6378137;

// A raster of 0.1 degrees each way with mountains, in degrees, and its tiles.
struct TiledTerrain {
  static constexpr uint32_t kSide = 201;
  Folder folder;
  std::string store = folder.File("t.mtdb");
  std::string tiles = folder.File("tiles");
  Json answer;

  static double Height(uint32_t column, uint32_t row) {
    const double x = column / 30.0, y = row / 30.0;
    return std::round(1500 + 900 * std::sin(x) * std::cos(y) + 60 * std::sin(7 * x + 3 * y));
  }
  TiledTerrain() {
    std::string text = "ncols 201\nnrows 201\nxllcenter 11.03\nyllcenter 47.02\ncellsize 0.0005\n";
    for (uint32_t row = 0; row < kSide; ++row) {
      for (uint32_t column = 0; column < kSide; ++column) {
        text += std::to_string(static_cast<int>(Height(column, row))) + " ";
      }
      text += "\n";
    }
    WriteText(folder.File("t.asc"), text);
    WriteText(folder.File("t.prj"),
              "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
              "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]");
    RunOk({"ingest", folder.File("t.asc"), store, "--quiet"});
    answer = RunJson({"tile", store, tiles, "--as", "quantized-mesh"});
  }
};
const TiledTerrain& TheTerrain() {
  static const TiledTerrain kTerrain;
  return kTerrain;
}

// Calls visit(level, x, y, tile) for all tiles.
template <typename Visit>
void ForEachTile(const TiledTerrain& terrain, const Visit& visit) {
  const Json layer = ParseJson(ReadText(terrain.tiles + "/layer.json"));
  const Json& available = layer.at("available");
  for (size_t level = 0; level < available.size(); ++level) {
    const Json& range = available.at(level).at(0);
    for (int x = range.at("startX"); x <= range.at("endX"); ++x) {
      for (int y = range.at("startY"); y <= range.at("endY"); ++y) {
        INFO("level " << level << ", x " << x << ", y " << y);
        visit(static_cast<int>(level), x, y,
              ReadQuantizedMesh(terrain.tiles + "/" + std::to_string(level) + "/" +
                                std::to_string(x) + "/" + std::to_string(y) + ".terrain"));
      }
    }
  }
}

double HeightOf(const ReadTerrain& tile, uint32_t v) {
  return tile.low + (tile.high - tile.low) * tile.vertices[v][2] / 32767.0;
}

TEST_CASE("layer.json says which tiles there are, and errors are the client's own", "[tile]") {
  const TiledTerrain& terrain = TheTerrain();
  const Json layer = ParseJson(ReadText(terrain.tiles + "/layer.json"));
  CHECK(layer.at("format") == "quantized-mesh-1.0");
  CHECK(layer.at("scheme") == "tms");
  CHECK(layer.at("projection") == "EPSG:4326");
  const size_t levels = layer.at("available").size();
  CHECK(layer.at("maxzoom") == levels - 1);
  CHECK(layer.at("available").at(0).at(0).at("endX") == 1);
  for (size_t level = 0; level < levels; ++level) {
    const double clients = kRadius * 2 * std::acos(-1.0) * 0.25 / (65 * 2) / std::pow(2.0, level);
    CHECK(layer.at("errorBounds").at(level).get<double>() <= clients);
    CHECK(terrain.answer.at("levels").at(level).at("error_bound") ==
          layer.at("errorBounds").at(level));
  }
  // Where the heights' zero lies nobody said.
  REQUIRE(terrain.answer.at("notes").size() == 1);
  const std::string note = terrain.answer.at("notes").at(0);
  CHECK_THAT(note, Catch::Contains("as if they were above the ellipsoid of WGS 84"));
  CHECK_THAT(note, Catch::Contains("33 to 51 m high there") && Catch::Contains("gdalwarp"));
  CHECK(layer.at("description") == note);
}

TEST_CASE("of heights above the ellipsoid there is nothing to be said", "[tile]") {
  const Folder folder;
  WriteText(folder.File("t.asc"),
            "ncols 3\nnrows 3\nxllcenter 11\nyllcenter 47\ncellsize 0.01\n"
            "100 100 100\n100 300 100\n100 100 100\n");
  const auto notes = [&](const std::string& crs) {
    WriteText(folder.File("t.prj"), crs);
    const std::string store = folder.File("t.mtdb"), tiles = folder.File("tiles");
    RunOk({"ingest", folder.File("t.asc"), store, "--replace", "--quiet"});
    return RunJson({"tile", store, tiles, "--as", "quantized-mesh", "--replace"}).at("notes");
  };
  // What gdalwarp writes for EPSG:4979, and the same without heights.
  const std::string begin =
      "GEOGCRS[\"WGS 84\",DATUM[\"World Geodetic System 1984\",ELLIPSOID[\"WGS "
      "84\",6378137,298.257223563,LENGTHUNIT[\"metre\",1]]],PRIMEM[\"Greenwich\",0,ANGLEUNIT["
      "\"degree\",0.0174532925199433]],CS[ellipsoidal,";
  const std::string axes =
      "AXIS[\"geodetic latitude (Lat)\",north,ORDER[1],ANGLEUNIT[\"degree\",0.0174532925199433]],"
      "AXIS[\"geodetic longitude (Lon)\",east,ORDER[2],ANGLEUNIT[\"degree\",0.0174532925199433]]";
  const std::string up =
      ",AXIS[\"ellipsoidal height (h)\",up,ORDER[3],LENGTHUNIT[\"metre\",1]],ID[\"EPSG\",4979]]";
  CHECK(notes(begin + "3]," + axes + up).empty());
  CHECK(notes(begin + "2]," + axes + ",ID[\"EPSG\",4326]]").size() == 1);
}

// A number of the grid's file, whose bytes are in the other order.
template <typename T>
T NumberIn(const std::string& bytes, size_t offset) {
  std::array<char, sizeof(T)> turned{};
  std::reverse_copy(bytes.begin() + static_cast<ptrdiff_t>(offset),
                    bytes.begin() + static_cast<ptrdiff_t>(offset + sizeof(T)), turned.begin());
  T number{};
  std::memcpy(&number, turned.data(), sizeof(T));
  return number;
}

TEST_CASE("the geoid is between what is said of it, as PROJ's grid has it", "[tile]") {
  // Debian's proj-data: from the south pole and 180 degrees west on, in quarters of a degree.
  const std::string grid = ReadText("/usr/share/proj/egm96_15.gtx");
  if (grid.size() != 40 + 4 * 721 * 1440) {
    WARN("skipped: without proj-data");
    return;
  }
  // Between nodes, counted in quarters of a degree.
  const auto lowest_and_highest = [&](int west, int south, int east, int north) {
    float low = 1000, high = -1000;
    for (int row = south; row <= north; ++row) {
      for (int column = west; column <= east; ++column) {
        const auto at = static_cast<size_t>(1440 * row + column % 1440);
        const auto height = NumberIn<float>(grid, 40 + 4 * at);
        low = std::min(low, height);
        high = std::max(high, height);
      }
    }
    return std::pair(static_cast<int>(std::floor(low)), static_cast<int>(std::ceil(high)));
  };
  std::mt19937 random(1);
  for (int i = 0; i < 300; ++i) {
    const int west = static_cast<int>(random() % 1440), south = static_cast<int>(random() % 721);
    const int east = west + static_cast<int>(random() % 100);
    const int north = std::min(south + static_cast<int>(random() % 100), 720);
    const GeoidRange range =
        GeoidOver({west / 4.0 - 180, south / 4.0 - 90, east / 4.0 - 180, north / 4.0 - 90});
    const auto [low, high] = lowest_and_highest(west, south, east, north);
    CHECK(range.low <= low);
    CHECK(range.high >= high);
  }
  // Of a single cell it says no more than there is.
  for (int south = 0; south < 720; south += 40) {
    for (int west = 0; west < 1440; west += 40) {
      const double x = west / 4.0 - 180, y = south / 4.0 - 90;
      const GeoidRange range = GeoidOver({x, y, x + 9.9, y + 9.9});
      CHECK(std::pair(range.low, range.high) ==
            lowest_and_highest(west, south, west + 40, south + 40));
    }
  }
  const GeoidRange earth = GeoidOver({-180, -90, 180, 90});
  CHECK(earth.low == -107);
  CHECK(earth.high == 86);
}

TEST_CASE("tiles cover their squares, and neighbours agree on their sides to the unit", "[tile]") {
  // By level, and by the line and place on it: heights.
  std::map<std::array<int, 3>, std::array<std::set<std::pair<int, double>>, 2>> lines;
  ForEachTile(TheTerrain(), [&](int level, int x, int y, const ReadTerrain& tile) {
    double area = 0;
    for (const auto& t : tile.triangles) {
      const auto at = [&](size_t i, size_t c) {
        return static_cast<double>(tile.vertices[t[i]][c]) / 32767;
      };
      const double twice = (at(1, 0) - at(0, 0)) * (at(2, 1) - at(0, 1)) -
                           (at(2, 0) - at(0, 0)) * (at(1, 1) - at(0, 1));
      CHECK(twice >= -1e-9);
      area += twice / 2;
    }
    CHECK(area == Approx(1).margin(1e-9));
    for (size_t side = 0; side < 4; ++side) {
      const size_t axis = side % 2, is_high = side / 2;
      std::set<std::pair<int, double>> found;
      for (const uint32_t v : tile.sides[side]) {
        CHECK(tile.vertices[v][axis] == (is_high != 0 ? 32767 : 0));
        found.insert({tile.vertices[v][1 - axis], HeightOf(tile, v)});
      }
      CHECK(found.contains({0, found.begin()->second}));
      const int line = 2 * level + static_cast<int>(axis);
      const int number = (axis == 0 ? x : y) + static_cast<int>(is_high);
      lines[{line, number, axis == 0 ? y : x}][is_high] = found;
    }
  });
  size_t shared = 0;
  for (const auto& [line, sides] : lines) {
    if (sides[0].empty() || sides[1].empty()) continue;
    INFO("line " << line[0] << ", " << line[1] << ", " << line[2]);
    CHECK(sides[0] == sides[1]);
    ++shared;
  }
  CHECK(shared > 50);
}

TEST_CASE("heights of a level are as true as it says", "[tile]") {
  const TiledTerrain& terrain = TheTerrain();
  const Json bounds = ParseJson(ReadText(terrain.tiles + "/layer.json")).at("errorBounds");
  std::map<int, std::vector<std::pair<std::string, double>>> places;
  ForEachTile(terrain, [&](int level, int x, int y, const ReadTerrain& tile) {
    const double side = 180.0 / (1 << level);
    for (const auto& t : tile.triangles) {
      double middle[3] = {0, 0, 0};
      for (const uint32_t v : t) {
        middle[0] += (x + tile.vertices[v][0] / 32767.0) * side / 3;
        middle[1] += (y + tile.vertices[v][1] / 32767.0) * side / 3;
        middle[2] += HeightOf(tile, v) / 3;
      }
      if (places[level].size() >= 500) break;
      const auto& a = tile.vertices[t[0]];
      const auto& b = tile.vertices[t[1]];
      const auto& c = tile.vertices[t[2]];
      if ((b[0] - a[0]) * (c[1] - a[1]) == (c[0] - a[0]) * (b[1] - a[1])) continue;  // a wall
      char place[80];
      std::snprintf(place, sizeof(place), "%.12f,%.12f", middle[0] - 180, middle[1] - 90);
      places[level].emplace_back(place, middle[2]);
    }
  });
  for (const auto& [level, of_level] : places) {
    if (level < 8) continue;  // ground beside the raster
    INFO("level " << level);
    std::string text;
    for (const auto& [place, height] : of_level) text += place + "\n";
    WriteText(terrain.folder.File("places"), text);
    const Json heights =
        RunJson({"probe", terrain.store, "--heights", terrain.folder.File("places")}).at("heights");
    size_t known = 0;
    for (size_t i = 0; i < of_level.size(); ++i) {
      const Json& height = heights.at(i).at("height");
      if (height.is_null()) continue;
      ++known;
      CHECK(std::abs(height.get<double>() - of_level[i].second) <=
            bounds.at(static_cast<size_t>(level)).get<double>());
    }
    CHECK(known > 10);
  }
}

TEST_CASE("the header's sphere holds the tile, and its normals look up", "[tile]") {
  ForEachTile(TheTerrain(), [&](int level, int x, int y, const ReadTerrain& tile) {
    const double side = 180.0 / (1 << level), degree = std::acos(-1.0) / 180;
    constexpr double kSquared = 0.00669437999014;
    for (uint32_t v = 0; v < tile.vertices.size(); ++v) {
      const double lon = ((x + tile.vertices[v][0] / 32767.0) * side - 180) * degree;
      const double lat = ((y + tile.vertices[v][1] / 32767.0) * side - 90) * degree;
      const double n = kRadius / std::sqrt(1 - kSquared * std::sin(lat) * std::sin(lat));
      const double h = HeightOf(tile, v);
      const Vec3d p{(n + h) * std::cos(lat) * std::cos(lon),
                    (n + h) * std::cos(lat) * std::sin(lon),
                    (n * (1 - kSquared) + h) * std::sin(lat)};
      CHECK(Length(p - tile.sphere) <= tile.radius + 1e-6);
      const std::string& normals = tile.extensions.at(1);
      REQUIRE(normals.size() == 2 * tile.vertices.size());
      double nx = static_cast<unsigned char>(normals[2 * v]) / 127.5 - 1;
      double ny = static_cast<unsigned char>(normals[2 * v + 1]) / 127.5 - 1;
      const double nz = 1 - std::abs(nx) - std::abs(ny);
      if (nz < 0) {
        const double folded = (1 - std::abs(ny)) * (nx < 0 ? -1 : 1);
        ny = (1 - std::abs(nx)) * (ny < 0 ? -1 : 1);
        nx = folded;
      }
      CHECK(Dot(Vec3d{nx, ny, nz}, p) > 0);
    }
    CHECK(tile.extensions.size() == 1);
    CHECK(Length(tile.horizon) >= 1);
  });
}

TEST_CASE("what is no terrain in degrees is told what to do", "[tile]") {
  const Folder folder;
  RunFails(1, {"tile", SmallExample().store, folder.File("q"), "--as", "quantized-mesh"},
           {"--at LON,LAT,HEIGHT"});
  CHECK_FALSE(Exists(folder.File("q")));
  const std::string metres = folder.File("m.asc");
  WriteText(metres,
            "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 3\n2 5 4\n3 1 4\n");
  RunOk({"ingest", metres, folder.File("m.mtdb"), "--quiet"});
  RunFails(1, {"tile", folder.File("m.mtdb"), folder.File("q"), "--as", "quantized-mesh"},
           {"gdalwarp"});
  RunFails(1,
           {"tile", TheTerrain().store, folder.File("q"), "--as", "quantized-mesh", "--at=1,2,3"},
           {"3dtiles"});
  RunFails(1, {"tile", TheTerrain().store, folder.File("q"), "--at=1,2,3"}, {"lies on the globe"});
}

TEST_CASE("verify measures terrain of both formats", "[tile]") {
  const TiledTerrain& terrain = TheTerrain();
  const Folder folder;
  RunOk({"tile", terrain.store, folder.File("t"), "--tile-triangles", "2000"});
  for (const std::string& tiles : {terrain.tiles, folder.File("t")}) {
    const Json report = RunJson({"verify", terrain.store, "--tiles", tiles});
    INFO(TextOf(report, 1));
    CHECK(report.at("ok") == true);
  }
}

TEST_CASE("tiles of Web Mercator", "[tile]") {
  const Folder folder;
  RunOk({"tile", TheTerrain().store, folder.File("q"), "--as", "quantized-mesh", "--mercator",
         "--max-level", "9"});
  const Json layer = ParseJson(ReadText(folder.File("q/layer.json")));
  CHECK(layer.at("projection") == "EPSG:3857");
  const Json& range = layer.at("available").at(9).at(0);
  // Longitude 11.03 of 512 columns; latitude 47.02 of rows from the south.
  CHECK(range.at("startX") == static_cast<int>((11.03 + 180) / 360 * 512));
  const double y =
      std::asinh(std::tan(47.02 * std::acos(-1.0) / 180)) / (2 * std::acos(-1.0)) + 0.5;
  CHECK(range.at("startY") == static_cast<int>(y * 512));
}

}  // namespace
}  // namespace mtdb::test
