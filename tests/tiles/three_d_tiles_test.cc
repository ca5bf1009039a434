// SPDX-License-Identifier: Apache-2.0
// What `mtdb tile` writes as 3D Tiles, read as clients do.
#include <cmath>
#include <limits>

#include "store/base/bytes.h"
#include "tests/tiles/tile_reading.h"

namespace mtdb::test {
namespace {

// A store of a sculpture with some 30,000 triangles, and its tiles of some 1,000.
struct TiledSculpture {
  Example example{30000};
  std::string folder = example.folder.File("tiles");
  Json answer =
      RunJson({"tile", example.store, folder, "--tile-triangles", "1000", "--threads", "2"});
  ReadTile root = ReadTileset(folder);
  std::map<int, std::vector<const ReadTile*>> levels;
  TiledSculpture() { TilesByLevel(root, &levels); }
};
const TiledSculpture& TheTiles() {
  static const TiledSculpture kTiles;
  return kTiles;
}

// The triangles of a level, those of several tiles once.
std::set<CornerTriangle> SurfaceOf(const std::string& folder,
                                   const std::vector<const ReadTile*>& tiles, double* step) {
  std::set<CornerTriangle> surface;
  for (const ReadTile* const tile : tiles) {
    const ReadGltf gltf = ReadGlb(folder + "/" + tile->uri);
    *step = gltf.step;
    CHECK(gltf.bound == tile->bound);
    for (const auto& t : gltf.surface) {
      surface.insert(Sorted({gltf.corners[t[0]], gltf.corners[t[1]], gltf.corners[t[2]]}));
    }
  }
  return surface;
}

// The same of a mesh file, on the lattice.
std::set<CornerTriangle> SurfaceOf(const TriangleMesh& mesh, double step, Vec3d origin,
                                   Corner origin_corner) {
  const auto corner = [&](VertexIndex v) {
    Corner c{};
    for (int i = 0; i < 3; ++i) {
      const auto at = static_cast<size_t>(i);
      c[at] = origin_corner[at] + std::llround((mesh.positions[v][i] - origin[i]) / step);
    }
    return c;
  };
  std::set<CornerTriangle> surface;
  for (const TriangleVertices& t : mesh.triangles) {
    surface.insert(Sorted({corner(t[0]), corner(t[1]), corner(t[2])}));
  }
  return surface;
}

TEST_CASE("the finest level's tiles, put together, are the mesh that extract writes", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  const auto& finest = tiles.levels.rbegin()->second;
  CHECK(finest.size() > 20);
  double step = 0;
  const std::set<CornerTriangle> surface = SurfaceOf(tiles.folder, finest, &step);
  CHECK(step == Approx(tiles.example.step()));
  const ReadGltf some = ReadGlb(tiles.folder + "/" + finest[0]->uri);
  const TriangleMesh full = ReadMesh(tiles.example.full);
  CHECK(SurfaceOf(full, step, some.positions[0], some.corners[0]) == surface);
}

TEST_CASE("a level has no cracks: each edge of its tiles has two triangles", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  REQUIRE(tiles.levels.size() >= 3);
  for (const auto& [level, of_level] : tiles.levels) {
    INFO("level " << level);
    double step = 0;
    const std::set<CornerTriangle> surface = SurfaceOf(tiles.folder, of_level, &step);
    std::set<std::pair<Corner, Corner>> edges;
    for (const CornerTriangle& t : surface) {
      for (size_t i = 0; i < 3; ++i) CHECK(edges.insert({t[i], t[(i + 1) % 3]}).second);
    }
    size_t alone = 0;
    for (const auto& [a, b] : edges) alone += edges.contains({b, a}) ? 0 : 1;
    CHECK(alone == 0);
  }
}

TEST_CASE("levels have the bounds that they state, and tiles their boxes and sizes", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  const TriangleMesh full = ReadMesh(tiles.example.full);
  const Json& levels = tiles.answer.at("levels");
  REQUIRE(levels.size() == tiles.levels.size());
  size_t number = 0;
  for (const auto& [level, of_level] : tiles.levels) {
    INFO("level " << level);
    const double bound = levels.at(number).at("error_bound");
    CHECK(levels.at(number++).at("tiles") == of_level.size());
    std::vector<Triangle3d> all;
    for (const ReadTile* const tile : of_level) {
      CHECK(tile->bound == bound);
      const ReadGltf gltf = ReadGlb(tiles.folder + "/" + tile->uri);
      CHECK(gltf.surface.size() <= 2600);
      for (const Vec3d& p : gltf.positions) {
        for (int i = 0; i < 3; ++i) {
          const auto at = static_cast<size_t>(i);
          CHECK(std::abs(p[i] - tile->box[at]) <= tile->box[3 + 4 * at] * (1 + 1e-9));
        }
      }
      for (const auto& t : gltf.surface) {
        all.push_back({gltf.positions[t[0]], gltf.positions[t[1]], gltf.positions[t[2]]});
      }
    }
    if (level > 1) continue;  // the distance takes long, and is 0 at last
    double farthest = 0;
    for (size_t v = 0; v < full.positions.size(); v += 7) {
      double nearest = std::numeric_limits<double>::infinity();
      for (const Triangle3d& t : all) {
        nearest =
            std::min(nearest, SquaredDistancePointTriangle(full.positions[v], t[0], t[1], t[2]));
      }
      farthest = std::max(farthest, nearest);
    }
    CHECK(std::sqrt(farthest) <= bound);
    CHECK(std::sqrt(farthest) > 0.3 * bound);
  }
}

TEST_CASE("tiles but the root's have skirts below edges where the level goes on", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  CHECK(ReadGlb(tiles.folder + "/" + tiles.root.uri).skirts.empty());
  const auto& finest = tiles.levels.rbegin()->second;
  for (const ReadTile* const tile : finest) {
    INFO(tile->uri);
    const ReadGltf gltf = ReadGlb(tiles.folder + "/" + tile->uri);
    std::map<std::pair<uint32_t, uint32_t>, int> edges;
    const auto add = [&](const std::array<uint32_t, 3>& t) {
      for (size_t i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
    };
    for (const auto& t : gltf.surface) add(t);
    const auto surface = edges;
    for (const auto& t : gltf.skirts) add(t);
    size_t open = 0;
    for (const auto& [edge, count] : surface) {
      if (surface.contains({edge.second, edge.first})) continue;
      CHECK(edges.contains({edge.second, edge.first}));
      ++open;
    }
    CHECK(gltf.skirts.size() == 2 * open);
  }
}

TEST_CASE("tiles depend neither on threads nor memory, and a killed run goes on", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  const Folder folder;
  const std::string other = folder.File("other");
  const Arguments arguments{"tile", tiles.example.store, other, "--tile-triangles",
                            "1000", "--threads",         "1",   "--memory",
                            "256M"};
  const pid_t child = Start(arguments, folder.File("out"), folder.File("err"));
  while (!Exists(other + "/1")) ::usleep(1000);
  ::kill(child, SIGKILL);
  const Outcome killed = Finish(child);
  CHECK((killed.signal == SIGKILL || killed.exit_code == 0));
  RunOk(arguments);
  const Json again = RunJson(arguments);  // and does nothing a third time
  CHECK(again.at("levels_found") == tiles.levels.size());
  size_t files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(tiles.folder)) {
    if (!entry.is_regular_file()) continue;
    ++files;
    const std::string name = std::filesystem::relative(entry.path(), tiles.folder);
    INFO(name);
    CHECK(ReadText(entry.path()) == ReadText(other + "/" + name));
  }
  CHECK(files > tiles.answer.at("tiles").get<size_t>());
}

TEST_CASE("what is in the folder is not written over", "[tile]") {
  const Example& example = SmallExample();
  const Folder folder;
  WriteText(folder.File("file"), "x");
  RunFails(1, {"tile", example.store, folder.File("file")}, {"expected a folder"});
  std::filesystem::create_directory(folder.File("full"));
  WriteText(folder.File("full/mine.txt"), "x");
  RunFails(1, {"tile", example.store, folder.File("full")}, {"not empty", "nothing was written"});
  CHECK(ReadText(folder.File("full/mine.txt")) == "x");
  const std::string tiles = folder.File("tiles");
  RunOk({"tile", example.store, tiles});
  RunFails(1, {"tile", example.store, tiles, "--pixels", "16"}, {"--replace"});
  RunOk({"tile", example.store, tiles, "--pixels", "16", "--replace"});
  CHECK(ReadTileset(tiles).children.empty());
}

TEST_CASE("a damaged record of what is written is told", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  const Folder folder;
  const std::string copy = folder.File("copy"), record = copy + "/mtdb-tiles.json";
  std::filesystem::copy(tiles.folder, copy, std::filesystem::copy_options::recursive);
  const std::string text = ReadText(record);
  const Arguments again{"tile", tiles.example.store, copy, "--tile-triangles", "1000"};
  RunOk(again);
  const Json whole = ParseJson(text);
  const auto refused = [&](const auto& change) {
    Json json = whole;
    change(json.at("progress"));
    WriteText(record, TextOf(json));
    RunFails(1, again, {"damaged", "remove the folder"});
  };
  refused([](Json& progress) { progress.erase("state"); });
  refused([](Json& progress) { progress["levels"][0]["bytes"] = "many"; });
  refused([](Json& progress) { progress["state"]["tree"][1]["tiles"][0][4] = 7; });
  refused([](Json& progress) { progress["state"]["tree"][0]["tiles"][0][6] = 1000; });
  refused([](Json& progress) { progress["state"]["tree"].erase(1); });
  WriteText(record, text.substr(0, text.size() / 2));
  RunFails(1, again, {"not empty"});
}

TEST_CASE("verify holds tiles against the object, and finds what is wrong", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  const Json report = RunJson({"verify", tiles.example.store, "--tiles", tiles.folder});
  CHECK(report.at("ok") == true);
  CHECK(report.at("level") == "tiles");
  const Folder folder;
  const std::string copy = folder.File("copy");
  const auto damaged = [&](const std::string& name, const auto& change, const std::string& what) {
    INFO(what);
    std::filesystem::remove_all(copy);
    std::filesystem::copy(tiles.folder, copy, std::filesystem::copy_options::recursive);
    std::string text = ReadText(copy + "/" + name);
    change(&text);
    WriteText(copy + "/" + name, text);
    const Outcome outcome = Run({"verify", tiles.example.store, "--tiles", copy});
    CHECK(outcome.exit_code == 1);
    CHECK_THAT(outcome.out, Catch::Contains("FAILED: ") && Catch::Contains(what));
  };
  const std::string root = tiles.root.uri;
  damaged(
      root, [](std::string* text) { text->resize(text->size() / 2); }, root);
  damaged(
      root, [](std::string* text) { text->clear(); }, root);
  // The root's glTF in the place of a finer tile, which promises more.
  const std::string fine = tiles.levels.at(1)[0]->uri;
  damaged(
      fine, [&](std::string* text) { *text = ReadText(tiles.folder + "/" + root); },
      "another bound");
  damaged(
      "tileset.json",
      [](std::string* text) {
        const std::string key = "\"geometricError\":";
        size_t at = text->find(key);
        for (int i = 0; i < 2; ++i) at = text->find(key, at + 1);
        text->insert(at + key.size(), "9");
      },
      "does not fall");
  RunFails(1, {"verify", tiles.example.store, "--tiles", folder.File("none")}, {"no tiles"});
}

// The files of a zip, by its central directory; the last one by itself.
std::map<std::string, std::pair<uint64_t, std::string>> ReadZip(const std::string& zip,
                                                                std::string* last) {
  std::map<std::string, std::pair<uint64_t, std::string>> files;
  ByteReader end(AsBytes(zip).subspan(zip.size() - 22));
  CHECK(end.Get<uint32_t>() == 0x06054b50);
  end.GetBytes(6);
  const auto count = end.Get<uint16_t>();
  end.GetBytes(4);
  ByteReader in(AsBytes(zip).subspan(end.Get<uint32_t>()));
  for (size_t i = 0; i < count; ++i) {
    REQUIRE(in.Get<uint32_t>() == 0x02014b50);
    in.GetBytes(6);
    CHECK(in.Get<uint16_t>() == 0);  // stored
    in.GetBytes(8);
    const auto packed = in.Get<uint32_t>(), bytes = in.Get<uint32_t>();
    CHECK(packed == bytes);
    const auto name_bytes = in.Get<uint16_t>();
    in.GetBytes(12);
    const auto offset = in.Get<uint32_t>();
    *last = AsString(in.GetBytes(name_bytes));
    files[*last] = {offset, zip.substr(offset + 30 + name_bytes, bytes)};
  }
  return files;
}

TEST_CASE("an archive .3tz has the folder's files, and an index of them at last", "[tile]") {
  const TiledSculpture& tiles = TheTiles();
  const Folder folder;
  const std::string path = folder.File("t.3tz");
  const Arguments arguments{"tile", tiles.example.store, path, "--tile-triangles", "1000"};
  const pid_t child = Start(arguments, folder.File("out"), folder.File("err"));
  while (!Exists(path + ".parts/1") && !Exists(path)) ::usleep(1000);
  ::kill(child, SIGKILL);
  Finish(child);
  if (!Exists(path)) RunOk(arguments);
  CHECK_FALSE(Exists(path + ".parts"));
  std::string last;
  const auto files = ReadZip(ReadText(path), &last);
  CHECK(last == "@3dtilesIndex1@");
  size_t found = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(tiles.folder)) {
    if (!entry.is_regular_file()) continue;
    const std::string name = std::filesystem::relative(entry.path(), tiles.folder);
    INFO(name);
    REQUIRE(files.contains(name));
    CHECK(files.at(name).second == ReadText(entry.path()));
    ++found;
  }
  CHECK(found + 1 == files.size());
  // Hashes rise, and lead to local headers.
  const std::string& index = files.at(last).second;
  REQUIRE(index.size() == 24 * found);
  std::set<uint64_t> offsets;
  for (const auto& [name, file] : files) offsets.insert(file.first);
  uint64_t before = 0;
  for (size_t i = 0; i < found; ++i) {
    ByteReader in(AsBytes(index).subspan(24 * i));
    const auto high = in.Get<uint64_t>();
    in.Get<uint64_t>();
    CHECK(offsets.contains(in.Get<uint64_t>()));
    CHECK(high > before);
    before = high;
  }
  const Arguments verify{"verify", tiles.example.store, "--tiles", path};
  CHECK(Run(verify).exit_code == 0);
  std::string text = ReadText(path);
  text[files.at(tiles.root.uri).first + 30 + tiles.root.uri.size() + 100] ^= 1;
  WriteText(path, text);
  CHECK(Run(verify).exit_code == 1);
  WriteText(path, text.substr(0, text.size() / 2));
  RunFails(1, verify, {"index"});
  RunFails(1, arguments, {"is there already"});
}

TEST_CASE("a place on the globe becomes the root's matrix", "[tile]") {
  const Example& example = SmallExample();
  const Folder folder;
  RunOk({"tile", example.store, folder.File("t"), "--at=90,0,100"});
  const Json tileset = ParseJson(ReadText(folder.File("t/tileset.json")));
  const Json& m = tileset.at("root").at("transform");
  REQUIRE(m.size() == 16);
  const auto column = [&](size_t i) {
    return Vec3d{m.at(4 * i), m.at(4 * i + 1), m.at(4 * i + 2)};
  };
  // At longitude 90 on the equator y is up, and -x is east.
  const Json& box = tileset.at("root").at("boundingVolume").at("box");
  const Vec3d middle{box.at(0), box.at(1), box.at(2)};
  const Vec3d on_globe =
      column(0) * middle.x + column(1) * middle.y + column(2) * middle.z + column(3);
  CHECK(on_globe.y > 6378137 + 100);
  CHECK(std::abs(on_globe.x) < 1e-3 * example.info.at("diagonal").get<double>() + 1e-6);
  CHECK(Length(column(0)) == Approx(1));
  CHECK(Dot(column(0), column(1)) == Approx(0).margin(1e-12));
  RunFails(2, {"tile", example.store, folder.File("u"), "--at=1,2"}, {"LON,LAT,HEIGHT"});
}

}  // namespace
}  // namespace mtdb::test
