// SPDX-License-Identifier: Apache-2.0
// What `mtdb tile --as terrain-rgb` writes, as a folder and as PMTiles, read as clients do.
#include <cmath>
#include <cstring>
#include <map>
#include <png.h>
#include <set>
#include <zlib.h>

#include "store/base/bytes.h"
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

const double kPi = std::acos(-1.0);
constexpr char kDegrees[] =
    "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
    "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]";

// A square raster of `side` samples, `cell` degrees apart, whose south-western one is at x and y.
template <typename Height>
std::string WriteTerrain(const Folder& folder, const std::string& name, uint32_t side, double x,
                         double y, const std::string& cell, const Height& height) {
  std::string text = "ncols " + std::to_string(side) + "\nnrows " + std::to_string(side) +
                     "\nxllcenter " + std::to_string(x) + "\nyllcenter " + std::to_string(y) +
                     "\ncellsize " + cell + "\nNODATA_value -9999\n";
  for (uint32_t row = 0; row < side; ++row) {
    for (uint32_t column = 0; column < side; ++column) {
      text += std::to_string(static_cast<int>(height(column, row))) + " ";
    }
    text += "\n";
  }
  WriteText(folder.File(name + ".asc"), text);
  WriteText(folder.File(name + ".prj"), kDegrees);
  const std::string store = folder.File(name + ".mtdb");
  RunOk({"ingest", folder.File(name + ".asc"), store, "--quiet"});
  return store;
}

// Hills, and their tiles of both encodings.
struct Hills {
  Folder folder;
  std::string store =
      WriteTerrain(folder, "hills", 201, 11.03, 47.02, "0.0005", [](auto c, auto r) {
        return std::round(1500 + 900 * std::sin(c / 30.0) * std::cos(r / 30.0) +
                          60 * std::sin(7 * c / 30.0 + r / 10.0));
      });
  std::string terrarium = folder.File("terrarium"), mapbox = folder.File("mapbox");
  Json answer = RunJson({"tile", store, terrarium, "--as", "terrain-rgb"});
  Hills() {
    RunOk({"tile", store, mapbox, "--as", "terrain-rgb", "--encoding", "mapbox", "--tile-pixels",
           "512"});
  }
};
const Hills& TheHills() {
  static const Hills kHills;
  return kHills;
}

struct Picture {
  uint32_t side = 0;
  std::vector<uint32_t> codes;  // red, green, blue
};
Picture ReadPicture(const std::string& bytes) {
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  REQUIRE(png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) != 0);
  CHECK(png.format == PNG_FORMAT_RGB);
  CHECK(png.width == png.height);
  png.format = PNG_FORMAT_RGB;
  std::vector<unsigned char> pixels(PNG_IMAGE_SIZE(png));
  REQUIRE(png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr) != 0);
  Picture picture;
  picture.side = png.width;
  for (size_t i = 0; i < pixels.size(); i += 3) {
    picture.codes.push_back(uint32_t{pixels[i]} << 16 | uint32_t{pixels[i + 1]} << 8 |
                            pixels[i + 2]);
  }
  return picture;
}

struct TileName {
  uint32_t z = 0, x = 0, y = 0;
  std::string path;
};
std::vector<TileName> TilesOf(const std::string& folder) {
  std::vector<TileName> tiles;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string name = std::filesystem::relative(entry.path(), folder);
    TileName tile;
    if (std::sscanf(name.c_str(), "%u/%u/%u.png", &tile.z, &tile.x, &tile.y) != 3) continue;
    tile.path = entry.path();
    tiles.push_back(tile);
  }
  return tiles;
}

double HeightOf(const std::string& encoding, uint32_t code) {
  return encoding == "mapbox" ? -10000 + code * 0.1 : code / 256.0 - 32768;
}

TEST_CASE("heights of pictures are those of the terrain within what is stated", "[tile]") {
  const Hills& hills = TheHills();
  for (const std::string& folder : {hills.terrarium, hills.mapbox}) {
    const Json json = ParseJson(ReadText(folder + "/tiles.json"));
    const std::string encoding = json.at("encoding");
    const uint32_t side = json.at("tileSize");
    const size_t levels = json.at("errorBounds").size();
    CHECK(json.at("maxzoom") == levels - 1);
    // As fine as the raster: 0.0005 degrees.
    CHECK(360 / std::pow(2, levels - 1) / side <= 0.0005);
    CHECK(360 / std::pow(2, levels - 2) / side > 0.0005);
    std::map<uint32_t, std::vector<double>> heights;
    std::map<uint32_t, std::string> places;
    for (const TileName& tile : TilesOf(folder)) {
      const Picture picture = ReadPicture(ReadText(tile.path));
      REQUIRE(picture.side == side);
      for (uint32_t i = 0; i < picture.codes.size(); i += 331) {
        const double x = (tile.x + (i % side + 0.5) / side) / std::pow(2, tile.z);
        const double y = (tile.y + (i / side + 0.5) / side) / std::pow(2, tile.z);
        char place[80];
        std::snprintf(place, sizeof(place), "%.12f,%.12f\n", x * 360 - 180,
                      std::atan(std::sinh(kPi * (1 - 2 * y))) * 180 / kPi);
        places[tile.z] += place;
        heights[tile.z].push_back(HeightOf(encoding, picture.codes[i]));
      }
    }
    for (const auto& [level, of_level] : heights) {
      INFO(encoding << ", level " << level);
      WriteText(hills.folder.File("places"), places[level]);
      const Json found =
          RunJson({"probe", hills.store, "--heights", hills.folder.File("places")}).at("heights");
      const double bound = json.at("errorBounds").at(level);
      double farthest = 0;
      size_t known = 0;
      for (size_t i = 0; i < of_level.size(); ++i) {
        const Json& height = found.at(i).at("height");
        if (height.is_null()) {
          // Beside the raster.
          CHECK(of_level[i] == 0);
          continue;
        }
        ++known;
        farthest = std::max(farthest, std::abs(height.get<double>() - of_level[i]));
      }
      CHECK(farthest <= bound);
      if (level + 1 == levels) {
        CHECK(known > 100);
        CHECK(farthest > 0.2 * bound);
      }
    }
  }
}

TEST_CASE("errors of levels are a part of a pixel, and rounding a part of them", "[tile]") {
  const Hills& hills = TheHills();
  const Json bounds = ParseJson(ReadText(hills.terrarium + "/tiles.json")).at("errorBounds");
  for (const TileName& tile : TilesOf(hills.terrarium)) {
    INFO("level " << tile.z);
    const double bound = bounds.at(tile.z);
    const double pixel = 2 * kPi * 6378137 / 256 / std::pow(2, tile.z);
    CHECK(bound <= pixel / 32);
    // The step: of which all heights are multiples.
    uint32_t step = 1;
    while (2 * step / 256.0 / 2 <= pixel / 32 / 4) step *= 2;
    size_t odd = 0;
    for (const uint32_t code : ReadPicture(ReadText(tile.path)).codes)
      odd += code % step == 0 ? 0 : 1;
    CHECK(odd == 0);
  }
  CHECK(hills.answer.at("levels").size() == bounds.size());
}

// PMTiles as its specification has it.
class Archive {
 public:
  explicit Archive(const std::string& path) : bytes_(ReadText(path)) {
    REQUIRE(bytes_.size() > 127);
    CHECK(bytes_.starts_with("PMTiles\3"));
    metadata = ParseJson(Unpacked(Number(24), Number(32)));
    Read(Number(8), Number(16));
  }
  uint64_t Number(size_t at) const {
    uint64_t value = 0;
    std::memcpy(&value, bytes_.data() + at, sizeof(value));
    return value;
  }
  uint8_t Byte(size_t at) const { return static_cast<uint8_t>(bytes_[at]); }

  Json metadata;
  std::map<uint64_t, std::string> tiles;  // by id
  size_t leaves = 0, entries = 0;
  std::set<uint64_t> offsets;

 private:
  std::string Unpacked(uint64_t offset, uint64_t size) const {
    z_stream stream{};
    REQUIRE(inflateInit2(&stream, 15 + 16) == Z_OK);
    std::string out(1 << 22, '\0');
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes_.data() + offset));
    stream.avail_in = static_cast<uInt>(size);
    stream.next_out = reinterpret_cast<Bytef*>(out.data());
    stream.avail_out = static_cast<uInt>(out.size());
    REQUIRE(inflate(&stream, Z_FINISH) == Z_STREAM_END);
    out.resize(stream.total_out);
    inflateEnd(&stream);
    return out;
  }
  void Read(uint64_t offset, uint64_t size) {
    const std::string text = Unpacked(offset, size);
    ByteReader in(AsBytes(text));
    const uint64_t count = in.GetVarint();
    std::vector<std::array<uint64_t, 4>> list(count);
    uint64_t id = 0;
    for (auto& e : list) e[0] = id += in.GetVarint();
    for (size_t i = 1; i < 3; ++i) {
      for (auto& e : list) e[i] = in.GetVarint();
    }
    for (size_t i = 0; i < count; ++i) {
      const uint64_t at = in.GetVarint();
      list[i][3] = at == 0 ? list[i - 1][3] + list[i - 1][2] : at - 1;
      const auto& [first, run, length, from] = list[i];
      if (run == 0) {
        ++leaves;
        Read(Number(40) + from, length);
        continue;
      }
      ++entries;
      offsets.insert(from);
      for (uint64_t k = 0; k < run; ++k)
        tiles[first + k] = bytes_.substr(Number(56) + from, length);
    }
    CHECK(in.remaining() == 0);
    REQUIRE_FALSE(in.failed());
  }
  const std::string bytes_;
};

// By walking along the curve: slow, and otherwise than the program.
uint64_t IdOf(uint32_t z, uint32_t x, uint32_t y) {
  uint64_t id = 0;
  for (uint32_t level = 0; level < z; ++level) id += uint64_t{1} << (2 * level);
  uint64_t along = 0;
  for (uint64_t s = uint64_t{1} << z >> 1; s > 0; s >>= 1) {
    const uint64_t rx = (x & s) > 0 ? 1 : 0, ry = (y & s) > 0 ? 1 : 0;
    along += s * s * ((3 * rx) ^ ry);
    if (ry == 0) {
      if (rx == 1) {
        x = static_cast<uint32_t>(s - 1 - (x & (s - 1)));
        y = static_cast<uint32_t>(s - 1 - (y & (s - 1)));
      }
      std::swap(x, y);
    }
  }
  return id + along;
}

TEST_CASE("PMTiles has the tiles of the folder, and what equals another one once", "[tile]") {
  const Hills& hills = TheHills();
  const std::string file = hills.folder.File("hills.pmtiles");
  RunOk({"tile", hills.store, file, "--as", "terrain-rgb"});
  CHECK_FALSE(Exists(file + ".parts"));
  const Archive archive(file);
  CHECK(IdOf(12, 3423, 1763) == 19078479);  // of the specification
  const std::vector<TileName> tiles = TilesOf(hills.terrarium);
  REQUIRE(archive.tiles.size() == tiles.size());
  for (const TileName& tile : tiles) {
    INFO(tile.path);
    CHECK(archive.tiles.at(IdOf(tile.z, tile.x, tile.y)) == ReadText(tile.path));
  }
  CHECK(archive.Number(72) == tiles.size());
  CHECK(archive.Number(80) == archive.entries);
  CHECK(archive.Number(88) == archive.offsets.size());
  CHECK(archive.Byte(96) == 1);
  CHECK(archive.Byte(99) == 2);
  CHECK(archive.metadata.at("encoding") == "terrarium");
  CHECK(RunJson({"verify", hills.store, "--tiles", file}).at("ok") == true);
  RunFails(1, {"tile", hills.store, file, "--as", "terrain-rgb"}, {"is there already"});
  RunOk({"tile", hills.store, file, "--as", "terrain-rgb", "--replace"});
  WriteText(hills.folder.File("mine.pmtiles"), "x");
  RunFails(
      1,
      {"tile", hills.store, hills.folder.File("mine.pmtiles"), "--as", "terrain-rgb", "--replace"},
      {"is there already"});

  // A plain has equal tiles, and a mountain in it others.
  const std::string plain =
      WriteTerrain(hills.folder, "plain", 101, 11, 47, "0.03",
                   [](auto c, auto r) { return c > 60 && c < 70 && r > 50 && r < 60 ? 900 : 500; });
  const std::string of_plain = hills.folder.File("plain.pmtiles");
  RunOk({"tile", plain, of_plain, "--as", "terrain-rgb", "--max-level", "10"});
  const Archive equal(of_plain);
  CHECK(equal.tiles.size() > 100);
  CHECK(equal.offsets.size() < equal.tiles.size() / 3);
  CHECK(equal.Number(88) == equal.offsets.size());
  CHECK(RunJson({"verify", plain, "--tiles", of_plain}).at("ok") == true);
}

TEST_CASE("a hole of a terrain is height 0 in pictures", "[tile]") {
  const Folder folder;
  const std::string store = WriteTerrain(folder, "hole", 101, 11, 47, "0.001", [](auto c, auto r) {
    return c > 40 && c < 60 && r > 40 && r < 60 ? -9999 : 700 + static_cast<int>(c);
  });
  for (const char* encoding : {"terrarium", "mapbox"}) {
    const std::string tiles = folder.File(encoding);
    RunOk({"tile", store, tiles, "--as", "terrain-rgb", "--encoding", encoding});
    size_t none = 0, wrong = 0;
    for (const TileName& tile : TilesOf(tiles)) {
      for (const uint32_t code : ReadPicture(ReadText(tile.path)).codes) {
        const double height = HeightOf(encoding, code);
        const bool is_none = std::abs(height) < 1e-6;
        none += is_none ? 1 : 0;
        wrong += is_none || (height > 500 && height < 1000) ? 0 : 1;
      }
    }
    CHECK(wrong == 0);
    CHECK(none > 0);
    CHECK(RunJson({"verify", store, "--tiles", tiles}).at("ok") == true);
  }
}

TEST_CASE("verify finds pictures that are not what they say", "[tile]") {
  const Hills& hills = TheHills();
  const Folder folder;
  const std::string copy = folder.File("copy");
  const std::vector<TileName> tiles = TilesOf(hills.terrarium);
  const auto finest = std::max_element(tiles.begin(), tiles.end(),
                                       [](const auto& a, const auto& b) { return a.z < b.z; });
  const std::string name = std::filesystem::relative(finest->path, hills.terrarium);
  const auto damaged = [&](const std::string& text, const std::string& what) {
    INFO(what);
    std::filesystem::remove_all(copy);
    std::filesystem::copy(hills.terrarium, copy, std::filesystem::copy_options::recursive);
    WriteText(copy + "/" + name, text);
    const Outcome outcome = Run({"verify", hills.store, "--tiles", copy});
    CHECK(outcome.exit_code == 1);
    CHECK_THAT(outcome.out, Catch::Contains("FAILED: ") && Catch::Contains(what));
  };
  const std::string text = ReadText(finest->path);
  damaged(text.substr(0, text.size() / 2), name);
  damaged("", name);
  damaged(ReadText(hills.terrarium + "/0/0/0.png"), "the tile states");
}

TEST_CASE("what terrain-rgb cannot hold is refused", "[tile]") {
  const Hills& hills = TheHills();
  const Folder folder;
  const std::string out = folder.File("t");
  RunFails(1, {"tile", SmallExample().store, out, "--as", "terrain-rgb"}, {"gdalwarp"});
  RunFails(1, {"tile", hills.store, out, "--as", "terrain-rgb", "--at=1,2,3"}, {"--at", "3dtiles"});
  RunFails(1, {"tile", hills.store, out + ".pmtiles", "--as", "3dtiles"},
           {".pmtiles", "terrain-rgb"});
  RunFails(1, {"tile", hills.store, out + ".3tz", "--as", "quantized-mesh"}, {".3tz", "3dtiles"});
  RunFails(2, {"tile", hills.store, out, "--as", "terrain-rgb", "--tile-pixels", "300"}, {"256"});
  const auto high = [](auto c, auto) { return 40000 + static_cast<int>(c); };
  const std::string store = WriteTerrain(folder, "high", 11, 11, 47, "0.01", high);
  RunFails(1, {"tile", store, out, "--as", "terrain-rgb"}, {"terrarium has -32768 to"});
  RunOk({"tile", store, out, "--as", "terrain-rgb", "--encoding", "mapbox"});
  const auto beyond = [](auto c, auto) { return 2000000 + static_cast<int>(c); };
  const std::string far = WriteTerrain(folder, "far", 11, 11, 47, "0.01", beyond);
  RunFails(1, {"tile", far, folder.File("q"), "--as", "quantized-mesh"}, {"heights", "1e6"});
  const std::string north = WriteTerrain(folder, "north", 11, 11, 85, "0.01", high);
  RunFails(1, {"tile", north, out, "--as", "terrain-rgb", "--encoding", "mapbox"},
           {"Web Mercator"});
}

TEST_CASE("a raster that is finer than units of quantized-mesh has bounds that hold", "[tile]") {
  const Folder folder;
  for (const char* cell : {"0.0000001", "0.00001"}) {
    const std::string store =
        WriteTerrain(folder, std::string("mini") + cell, 21, 11, 47, cell,
                     [](auto c, auto r) { return 200 + c * 7919 * (r + 3) % 2500; });
    const std::string tiles = folder.File(std::string("q") + cell);
    RunOk({"tile", store, tiles, "--as", "quantized-mesh"});
    const Json report = RunJson({"verify", store, "--tiles", tiles});
    INFO(TextOf(report, 1));
    CHECK(report.at("ok") == true);
  }
}

}  // namespace
}  // namespace mtdb::test
