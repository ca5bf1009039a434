// SPDX-License-Identifier: Apache-2.0
// ingest --weld.
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// A tile of 10 x 10 squares from `x0` on.
std::string Tile(double x0, double shift) {
  std::string text;
  for (int y = 0; y <= 10; ++y) {
    for (int x = 0; x <= 10; ++x) {
      text += "v " + std::to_string(x0 + x) + " " + std::to_string(y + (x == 0 ? shift : 0.0)) +
              " " + std::to_string((x * y) % 3 * 0.5) + "\n";
    }
  }
  for (int y = 0; y < 10; ++y) {
    for (int x = 0; x < 10; ++x) {
      const int v = y * 11 + x + 1;
      text += "f " + std::to_string(v) + " " + std::to_string(v + 1) + " " +
              std::to_string(v + 12) + " " + std::to_string(v + 11) + "\n";
    }
  }
  return text;
}

}  // namespace

TEST_CASE("--weld makes one surface of tiles in several files", "[cli]") {
  const Folder folder;
  const std::string a = folder.File("a.obj");
  const std::string b = folder.File("b.obj");
  WriteText(a, Tile(0, 0));
  // At x = 10 the heights of the tiles agree at every third vertex only.
  std::string second = Tile(10, 0);
  for (int y = 0; y <= 10; ++y) {
    const std::string from = "v 10.000000 " + std::to_string(static_cast<double>(y)) + " 0.000000";
    const std::string to = "v 10.000000 " + std::to_string(static_cast<double>(y)) + " " +
                           std::to_string((10 * y) % 3 * 0.5);
    second.replace(second.find(from), from.size(), to);
  }
  WriteText(b, second);
  const auto ingest = [&](const Arguments& more) {
    Arguments arguments{"ingest", a, b, folder.File("s.mtdb"), "--name", "tiles", "--replace"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunJson(arguments);
  };
  const Json kept = ingest({"--no-weld"});
  CHECK(kept.at("components") == 2);
  CHECK(kept.at("welded_vertices") == 0);
  // Tiles that adjoin exactly are one by themselves.
  const Json joined = ingest({});
  CHECK(joined.at("components") == 1);
  CHECK(joined.at("welded_vertices") == 11);
  CHECK(joined.at("equal_vertices") == 0);
  RunFails(2, {"ingest", a, folder.File("u.mtdb"), "--weld=0", "--no-weld"}, {"--no-weld"});
  const Json welded = ingest({"--weld"});
  CHECK(welded.at("components") == 1);
  CHECK(welded.at("welded_vertices") == 11);
  CHECK(welded.at("triangles") == 400);
  CHECK(ingest({"--weld", "0.001"}).at("digest") == welded.at("digest"));
  CHECK(ingest({"--weld=0", "--memory", "256M", "--threads", "1"}).at("digest") ==
        welded.at("digest"));
  CHECK_THAT(RunOk({"ingest", a, b, folder.File("t.mtdb"), "--weld"}),
             Catch::Contains("11 vertices welded"));
  // A word that is no tolerance is told from one.
  RunFails(2, {"ingest", "--weld", a, b, folder.File("u.mtdb")}, {"--weld=0"});
  RunFails(2, {"ingest", a, folder.File("u.mtdb"), "--weld=-1"}, {"--weld"});
  RunFails(1, {"ingest", a, b, folder.File("u.mtdb"), "--weld", "100", "--quiet"},
           {"tolerance of 100", "edges"});
  CHECK(!Exists(folder.File("u.mtdb")));
}

TEST_CASE("A cut that different attributes keep open is told of, with what joins it", "[cli]") {
  const Folder folder;
  const std::string path = folder.File("a.ply");
  // Two squares with a normal each: flat shading.
  WriteText(path,
            "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
            "property float z\nproperty float nx\nproperty float ny\nproperty float nz\n"
            "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\n0 1 0 0 0 1\n"
            "1 0 0 1 0 0\n1 0 -1 1 0 0\n1 1 -1 1 0 0\n1 1 0 1 0 0\n"
            "4 0 1 2 3\n4 4 5 6 7\n");
  const Json plain = RunJson({"ingest", path, folder.File("s.mtdb")});
  CHECK(plain.at("components") == 2);
  CHECK(plain.at("equal_vertices") == 2);
  REQUIRE(plain.at("warnings").size() == 1);
  CHECK_THAT(plain.at("warnings")[0].get<std::string>(),
             Catch::Contains("2 vertices") && Catch::Contains("--weld would join"));
  CHECK_THAT(RunOk({"info", path}), Catch::Contains("--weld would join"));
  const Json welded = RunJson({"ingest", path, folder.File("w.mtdb"), "--weld"});
  CHECK(welded.at("components") == 1);
  CHECK(welded.at("warnings").empty());
}

}  // namespace mtdb::test
