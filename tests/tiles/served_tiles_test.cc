// SPDX-License-Identifier: Apache-2.0
// Tiles that `mtdb serve` makes when they are asked for, against those that `mtdb tile` writes.
#include <atomic>
#include <filesystem>
#include <thread>

#include "tests/tiles/tile_reading.h"
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

// The files of a tree, by their names in it, but for mtdb's own record.
std::map<std::string, std::string> FilesOf(const std::string& tree) {
  std::map<std::string, std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(tree)) {
    const std::string name = std::filesystem::relative(entry.path(), tree).generic_string();
    if (entry.is_regular_file() && name != "mtdb-tiles.json") files[name] = ReadText(entry.path());
  }
  return files;
}

std::map<std::string, std::string> Written(const std::string& store, const Folder& folder,
                                           const Arguments& options) {
  const std::string tree = folder.File("tree");
  std::filesystem::remove_all(tree);
  Arguments arguments{"tile", store, tree, "--quiet"};
  arguments.insert(arguments.end(), options.begin(), options.end());
  RunOk(arguments);
  return FilesOf(tree);
}

HttpAnswer Ask(const ServerProcess& server, const std::string& target, const std::string& headers,
               const std::string& method = "GET") {
  RawConnection connection(server.port());
  connection.Send(RequestText(method, target, "", headers));
  return connection.ReceiveAnswer(false);
}

// Mountains of 0.1 degrees each way.
std::string TerrainStore(const Folder& folder) {
  std::string text = "ncols 201\nnrows 201\nxllcenter 11.03\nyllcenter 47.02\ncellsize 0.0005\n";
  for (int row = 0; row < 201; ++row) {
    for (int column = 0; column < 201; ++column) {
      const double x = column / 30.0, y = row / 30.0;
      text += std::to_string(std::lround(1500 + 900 * std::sin(x) * std::cos(y))) + " ";
    }
    text += "\n";
  }
  WriteText(folder.File("t.asc"), text);
  WriteText(folder.File("t.prj"),
            "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563]],"
            "PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433]]");
  RunOk({"ingest", folder.File("t.asc"), folder.File("t.mtdb"), "--quiet"});
  return folder.File("t.mtdb");
}

std::string TypeOf(const std::string& name) {
  if (name.ends_with(".json") || name.ends_with("info")) return "application/json";
  if (name.ends_with(".glb")) return "model/gltf-binary";
  if (name.ends_with(".png")) return "image/png";
  return name.ends_with(".terrain") ? "application/vnd.quantized-mesh" : "application/octet-stream";
}

void CheckSame(const ServerProcess& server, const std::string& base,
               const std::map<std::string, std::string>& files, size_t least) {
  INFO(base);
  CHECK(files.size() >= least);
  for (const auto& [name, bytes] : files) {
    INFO(name);
    const HttpAnswer answer = server.Get(base + name);
    CHECK(answer.status == 200);
    CHECK(answer.body == bytes);
    CHECK(answer.header("Content-Type") == TypeOf(name));
  }
}

TEST_CASE("the server gives the files that mtdb tile writes, byte for byte", "[tile]") {
  const Example example(30000);
  const Folder folder;
  const std::string packed = folder.File("s.mtdbp");
  RunOk({"pack", example.store, packed});
  const auto coarse = Written(example.store, folder, {});
  const auto fine =
      Written(example.store, folder,
              {"--tile-triangles", "1000", "--at", "11.57,48.14,520", "--pixels", "4"});
  for (const std::string& store : {example.store, packed}) {
    INFO(store);
    const ServerProcess server(store);
    const std::string base = "/objects/sculpture/3dtiles/";
    CheckSame(server, base, coarse, 2);
    CheckSame(server, base + "tile-triangles=1000&at=11.57,48.14,520&pixels=4/", fine, 60);
    CHECK(server.temporary_files() == 0);  // they have no names
  }
}

TEST_CASE("the server gives tiles of terrains for globes and maps", "[tile]") {
  const Folder folder;
  const std::string store = TerrainStore(folder);
  const ServerProcess server(store);
  const std::string base = "/objects/t/";
  CheckSame(server, base + "quantized-mesh/", Written(store, folder, {"--as", "quantized-mesh"}),
            12);
  CheckSame(server, base + "quantized-mesh/mercator=true&max-level=11/",
            Written(store, folder, {"--as", "quantized-mesh", "--mercator", "--max-level", "11"}),
            12);
  CheckSame(server, base + "terrain-rgb/", Written(store, folder, {"--as", "terrain-rgb"}), 12);
  CheckSame(server, base + "terrain-rgb/encoding=mapbox&tile-pixels=512/",
            Written(store, folder,
                    {"--as", "terrain-rgb", "--encoding", "mapbox", "--tile-pixels", "512"}),
            12);
  CheckSame(server, base + "3dtiles/", Written(store, folder, {}), 2);
  // As layer.json has it: what is of this version for good.
  const std::string tiles = server.Get(base + "quantized-mesh/layer.json").json().at("tiles").at(0);
  const std::string version = tiles.substr(tiles.find('?'));
  CHECK_THAT(server.Get(base + "quantized-mesh/0/0/0.terrain" + version).header("Cache-Control"),
             Catch::Contains("immutable"));
  CHECK(server.Get(base + "quantized-mesh/0/0/0.terrain?v=0").header("Cache-Control") ==
        "no-cache");
}

TEST_CASE("the server gives neuroglancer's files, and parts of fragments", "[tile]") {
  const Example example(30000);
  const Folder folder;
  const Arguments options{"--as", "neuroglancer", "--tile-triangles", "1000"};
  const auto files = Written(example.store, folder, options);
  const ServerProcess server(example.store, {"--allowed-origin", "*"});
  const std::string base = "/objects/sculpture/neuroglancer/tile-triangles=1000/";
  CheckSame(server, base, files, 4);
  const auto more = Written(
      example.store, folder,
      {"--as", "neuroglancer", "--bits", "10", "--pixels", "3", "--resolution", "100,200,300"});
  CheckSame(server, "/objects/sculpture/neuroglancer/bits=10&pixels=3&resolution=100,200,300/",
            more, 4);
  const std::string& fragments = files.at("1");
  REQUIRE(fragments.size() > 10'000);
  const auto part = [&](const std::string& range) {
    return Ask(server, base + "1", "Range: bytes=" + range + "\r\n");
  };
  // Across the files of levels that it is made of, too.
  for (size_t begin = 0; begin < fragments.size(); begin += 997) {
    const size_t size = std::min<size_t>(1500, fragments.size() - begin);
    const HttpAnswer answer = part(std::to_string(begin) + "-" + std::to_string(begin + size - 1));
    CHECK(answer.status == 206);
    CHECK(answer.body == fragments.substr(begin, size));
    CHECK(answer.header("Access-Control-Expose-Headers") == "ETag, Content-Range");
  }
  CHECK(part("7-9").header("Content-Range") == "bytes 7-9/" + std::to_string(fragments.size()));
  CHECK(part(std::to_string(fragments.size()) + "-").status == 416);
  CHECK(Ask(server, base + "1", "Range: bytes=7-9\r\nIf-Range: \"other\"\r\n").body == fragments);
  CHECK(server.Get(base + "2").code() == "no_such_tile");
  CHECK(server.Get(base + "0/0_0_0.drc").code() == "no_such_tile");
  CHECK(server.Get("/objects/sculpture/neuroglancer/sharded=true/info").status == 400);
  // A name that is a number is the id; a terrain in degrees has no place there.
  const std::string terrain = TerrainStore(folder);
  CHECK(ServerProcess(terrain).Get("/objects/t/neuroglancer/info").status == 400);
  RunOk({"rename", example.store, "sculpture", "47"});
  CHECK(server.Get("/objects/47/neuroglancer/tile-triangles=1000/47").body == fragments);
}

TEST_CASE("a tile is sent again only when its object or its options have changed", "[tile]") {
  const Example example(2000);
  const ServerProcess server(example.store);
  const std::string base = "/objects/sculpture/3dtiles/", set = base + "tileset.json";
  const std::string tag = server.Get(set).header("ETag");
  REQUIRE(tag.size() > 34);
  const auto known = [&](const std::string& target, const std::string& tags) {
    return Ask(server, target, "If-None-Match: " + tags + "\r\n").status;
  };
  CHECK(known(set, tag) == 304);
  CHECK(known(set, "\"other\", W/" + tag) == 304);
  CHECK(known(set, "\"other\"") == 200);
  CHECK(known(base + "pixels=4/tileset.json", tag) == 200);
  CHECK(known(base + "0/0_0_0_0.glb", tag) == 200);
  const HttpAnswer not_modified = Ask(server, set, "If-None-Match: " + tag + "\r\n");
  CHECK(not_modified.header("ETag") == tag);
  CHECK(not_modified.body.empty());
  CHECK(not_modified.header("Content-Length").empty());
  const std::string before = server.Get(set).body;
  // Another object of that name.
  const Folder folder;
  RunOk({"generate", "sculpture", folder.File("sculpture.ply"), "--triangles", "3000"});
  RunOk({"ingest", folder.File("sculpture.ply"), example.store, "--replace", "--quiet"});
  CHECK(known(set, tag) == 200);
  CHECK(server.Get(set).header("ETag") != tag);
  CHECK(server.Get(set).body != before);
}

TEST_CASE("pages of the allowed origin may read tiles, and no other answers", "[tile]") {
  const std::string set = "/objects/sculpture/3dtiles/tileset.json";
  const auto allowed = [](const HttpAnswer& answer) {
    return answer.header("Access-Control-Allow-Origin");
  };
  const Example& example = SmallExample();
  const std::string page = "http://localhost:3000";
  {
    const ServerProcess server(example.store, {"--allowed-origin", page});
    const std::string tag = server.Get(set).header("ETag");
    CHECK(allowed(server.Get(set)) == page);
    CHECK(allowed(server.Get("/objects/sculpture/3dtiles/9/9_9_9_9.glb")) == page);
    CHECK(allowed(Ask(server, set, "If-None-Match: " + tag + "\r\n")) == page);
    CHECK(allowed(server.Get("/objects/sculpture")).empty());
    CHECK(allowed(server.Get("/objects/sculpture/mesh?error=1")).empty());
    const HttpAnswer asked = Ask(server, set, "Origin: " + page + "\r\n", "OPTIONS");
    CHECK(asked.status == 204);
    CHECK(allowed(asked) == page);
    CHECK(asked.header("Access-Control-Allow-Methods") == "GET, HEAD");
  }
  const ServerProcess server(example.store);
  CHECK(allowed(server.Get(set)).empty());
}

TEST_CASE("the server refuses tiles that there are not, and says why", "[tile]") {
  const ServerProcess server(SmallExample().store);
  const std::string base = "/objects/sculpture/3dtiles/";
  for (const char* file : {"0/0_0_0_1.glb", "1/0_0_0_0.glb", "0/0_0_0_0", "0", "../tileset.json",
                           "%2e%2e/%2e%2e/etc/passwd", "0/-1_0_0_0.glb", "00/0_0_0_0.glb",
                           "99999999999999999999/0_0_0_0.glb", "0/0_0_0_0.glb/", "mtdb-tiles.json",
                           "0%2F0_0_0_0.glb.tmp"}) {
    INFO(file);
    const HttpAnswer answer = server.Get(base + file);
    CHECK(answer.status == 404);
    CHECK(answer.code() == "no_such_tile");
    CHECK_THAT(answer.error(), Catch::Contains("tileset.json"));
  }
  const auto refused = [&](const std::string& target, const std::string& what) {
    INFO(target);
    const HttpAnswer answer = server.Get(target);
    CHECK(answer.status == 400);
    CHECK_THAT(answer.error(), Catch::Contains(what));
  };
  refused(base + "pixels=-1/tileset.json", "pixels: ");
  refused(base + "at=1,95,0/tileset.json", "at: ");
  refused(base + "at=1,nan,0/tileset.json", "at: ");
  refused(base + "tile-triangles=1/tileset.json", "tile-triangles: ");
  refused(base + "mercator=true/tileset.json", "it has at, pixels, tile-triangles");
  refused(base + "pixels=4&/tileset.json", "NAME=VALUE");
  refused(base + "tileset.json?pixels=4", "in the path");
  refused("/objects/sculpture/quantized-mesh/layer.json", "3dtiles");
  refused("/objects/sculpture/terrain-rgb/tiles.json", "raster");
  CHECK(server.Get("/objects/nothing/3dtiles/tileset.json").code() == "no_such_object");
  CHECK(server.Get("/objects/sculpture/4dtiles/tileset.json").code() == "no_such_path");
  CHECK(server.Ask("POST", base + "tileset.json").status == 405);
}

TEST_CASE("trees of tiles take no more temporary files than they may", "[tile]") {
  const Example& example = SmallExample();
  {
    const ServerProcess server(example.store, {"--tile-space", "100K"});
    const HttpAnswer answer = server.Get("/objects/sculpture/3dtiles/tileset.json");
    CHECK(answer.status == 400);
    CHECK_THAT(answer.error(), Catch::Contains("--tile-space") && Catch::Contains("102400"));
  }
  // For one tree, and not for two: the first one is made anew.
  const ServerProcess server(example.store, {"--tile-space", "170K"});
  const std::string base = "/objects/sculpture/3dtiles/";
  const auto made = [&] { return server.Metric("mtdb_queries_total"); };
  const std::string set = server.Get(base + "tileset.json").body;
  CHECK(server.Get(base + "0/0_0_0_0.glb").status == 200);
  CHECK(made() == 1);
  CHECK(server.Get(base + "pixels=4/tileset.json").status == 200);
  CHECK(server.Get(base + "pixels=4/0/0_0_0_0.glb").status == 200);
  CHECK(made() == 2);
  CHECK(server.Get(base + "tileset.json").body == set);
  CHECK(made() == 3);
  CHECK(server.Metric("mtdb_tile_space_evictions_total") == 2);
  CHECK(server.Metric("mtdb_tile_space_bytes") > 50'000);
  CHECK(server.Metric("mtdb_tile_space_bytes") < 160'000);
  CHECK(server.Metric("mtdb_tile_space_limit_bytes") == 170 * 1024);
}

TEST_CASE("tiles larger than meshes may be are refused", "[tile]") {
  const ServerProcess server(TheExample().store, {"--max-triangles", "5000"});
  const std::string base = "/objects/sculpture/3dtiles/";
  CHECK(server.Get(base + "tileset.json").status == 200);
  const HttpAnswer answer = server.Get(base + "0/0_0_0_0.glb");
  CHECK(answer.status == 400);
  CHECK_THAT(answer.error(), Catch::Contains("at most 5000") && Catch::Contains("tile-triangles"));
  CHECK(server.Get(base + "tile-triangles=2000/0/0_0_0_0.glb").status == 200);
}

TEST_CASE("clients who ask for one tree at once have it made once", "[tile]") {
  const Example example(30000);
  const ServerProcess server(example.store, {"--threads", "4"});
  const std::string base = "/objects/sculpture/3dtiles/tile-triangles=1000/";
  std::atomic<int> right = 0;
  {
    std::vector<std::jthread> clients;
    for (int i = 0; i < 8; ++i) {
      clients.emplace_back([&] {
        for (int k = 0; k < 10; ++k) right += server.Get(base + "tileset.json").status == 200;
      });
    }
  }
  CHECK(right == 80);
  CHECK(server.Metric("mtdb_queries_total") == 1);
}

TEST_CASE("a client who leaves while his tree is made stops it, and the next one gets it",
          "[tile]") {
  const Example example(200000);
  const ServerProcess server(example.store, {"--threads", "1"});
  const std::string set = "/objects/sculpture/3dtiles/tile-triangles=100/tileset.json";
  {
    RawConnection gone(server.port());
    gone.Send(RequestText("GET", set));
    CHECK(server.Reaches("mtdb_queries_total", 1));
  }
  CHECK(server.Reaches("mtdb_queries_cancelled_total", 1));
  CHECK(server.Get(set).status == 200);
  CHECK(server.Metric("mtdb_queries_total") == 2);
}

}  // namespace
}  // namespace mtdb::test
