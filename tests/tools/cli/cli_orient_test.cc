// SPDX-License-Identifier: Apache-2.0
// ingest --orient, and what is said of triangles that disagree about the outside.
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// A square of n x n cells, of which each k-th triangle looks down.
std::string Square(int n, int k) {
  std::string text;
  for (int y = 0; y <= n; ++y) {
    for (int x = 0; x <= n; ++x) {
      text += "v " + std::to_string(x) + " " + std::to_string(y) + " " +
              std::to_string((x * y) % 3 * 0.25) + "\n";
    }
  }
  int count = 0;
  const auto face = [&](int a, int b, int c) {
    if (++count % k == 0) std::swap(b, c);
    text += "f " + std::to_string(a) + " " + std::to_string(b) + " " + std::to_string(c) + "\n";
  };
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const int v = y * (n + 1) + x + 1;
      face(v, v + 1, v + n + 2);
      face(v, v + n + 2, v + n + 1);
    }
  }
  return text;
}

// A Moebius band of five triangles, the fewest that it has.
const char* const kMoebius =
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0.5 1\n"
    "f 1 2 3\nf 2 3 4\nf 3 4 5\nf 4 5 1\nf 5 1 2\n";

}  // namespace

TEST_CASE("--orient makes sheets consistent and says how many triangles it turned over", "[cli]") {
  const Folder folder;
  const std::string mixed = folder.File("mixed.obj"), plain = folder.File("plain.obj");
  WriteText(mixed, Square(20, 7));
  WriteText(plain, Square(20, 1 << 20));
  const Json before = RunJson({"ingest", mixed, folder.File("a.mtdb")});
  CHECK(before.at("input").at("inconsistent_edges") > 100);
  CHECK(before.at("input").at("inconsistent_edges") == before.at("input").at("nonmanifold_edges"));
  CHECK(before.at("input").at("turned_triangles") == 0);
  CHECK(before.at("input").at("unorientable_sheets") == 0);
  CHECK(before.at("warnings").at(0).get<std::string>().find("--orient") != std::string::npos);
  const Json after = RunJson({"ingest", mixed, folder.File("b.mtdb"), "--orient"});
  CHECK(after.at("input").at("inconsistent_edges") == 0);
  CHECK(after.at("input").at("turned_triangles") == 800 / 7);
  CHECK(after.at("warnings").empty());
  const Json expected = RunJson({"ingest", plain, folder.File("c.mtdb")});
  RunOk({"extract", folder.File("b.mtdb"), folder.File("b.obj"), "--full"});
  RunOk({"extract", folder.File("c.mtdb"), folder.File("c.obj"), "--full"});
  CHECK(ReadText(folder.File("b.obj")) == ReadText(folder.File("c.obj")));
  // A mesh that is consistent stays as it is.
  CHECK(RunJson({"ingest", plain, folder.File("d.mtdb"), "--orient"}).at("digest") ==
        expected.at("digest"));
  CHECK_THAT(RunOk({"ingest", mixed, folder.File("e.mtdb"), "--orient"}),
             Catch::Contains("114 triangles turned over"));
  CHECK_THAT(RunOk({"ingest", mixed, folder.File("f.mtdb")}),
             Catch::Contains("disagree about the outside") && Catch::Contains("--orient"));
  // The store knows it.
  const Json info = RunJson({"info", folder.File("b.mtdb")});
  CHECK(info.at("objects").at(0).at("input") == after.at("input"));
}

TEST_CASE("info says what --orient would do before anything is stored", "[cli]") {
  const Folder folder;
  const std::string mixed = folder.File("mixed.obj");
  WriteText(mixed, Square(20, 7));
  const Json survey = RunJson({"info", mixed});
  CHECK(survey.at("turned_triangles") == 114);
  CHECK(survey.at("unorientable_sheets") == 0);
  CHECK(survey.at("inconsistent_edges") > 100);
  CHECK_THAT(RunOk({"info", mixed}), Catch::Contains("--orient turns 114 triangles over"));
  CHECK_THAT(RunOk({"ingest", mixed, folder.File("s.mtdb"), "--dry-run", "--orient"}),
             Catch::Contains("114 triangles are turned over"));
}

TEST_CASE("A Moebius band stays as it is with --orient, and is counted", "[cli]") {
  const Folder folder;
  const std::string band = folder.File("band.obj");
  WriteText(band, kMoebius);
  const Json plain = RunJson({"ingest", band, folder.File("a.mtdb")});
  CHECK(plain.at("input").at("unorientable_sheets") == 1);
  const Json oriented = RunJson({"ingest", band, folder.File("b.mtdb"), "--orient"});
  CHECK(oriented.at("input") == plain.at("input"));
  CHECK(oriented.at("digest") == plain.at("digest"));
  CHECK_THAT(RunOk({"info", band}), Catch::Contains("Moebius"));
}

TEST_CASE("--orient lets a height field with faces upside down become a terrain", "[cli]") {
  const Folder folder;
  const std::string mixed = folder.File("mixed.obj");
  WriteText(mixed, Square(20, 7));
  RunFails(1, {"ingest", mixed, folder.File("a.mtdb"), "--terrain", "--quiet"}, {"folded"});
  CHECK(RunJson({"ingest", mixed, folder.File("b.mtdb"), "--terrain", "--orient"})
            .at("error_measure") == "vertical");
}

TEST_CASE("--orient is not for rasters", "[cli]") {
  const Folder folder;
  const std::string raster = folder.File("r.asc");
  WriteText(raster, "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2\n3 4\n");
  RunFails(1, {"ingest", raster, folder.File("a.mtdb"), "--orient", "--quiet"},
           {"--orient", "raster"});
}

}  // namespace mtdb::test
