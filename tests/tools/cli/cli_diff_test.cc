// SPDX-License-Identifier: Apache-2.0
// What `mtdb diff` tells, its exit statuses, and how it refuses.
#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// Two objects of one store: the example's sculpture, and another with a bump.
struct Pair {
  Folder folder;
  std::string store = folder.File("pair.mtdb");
  Pair() {
    const std::string flat = folder.File("flat.obj"), bump = folder.File("bump.obj");
    WriteText(flat, Sheet(0));
    WriteText(bump, Sheet(0.5));
    RunOk({"ingest", flat, store, "--name", "flat"});
    RunOk({"ingest", bump, store, "--name", "bump"});
  }
  // 20 x 20 squares of side 1 with one vertex at that height.
  static std::string Sheet(double height) {
    std::string text;
    for (int y = 0; y <= 20; ++y) {
      for (int x = 0; x <= 20; ++x) {
        text += "v " + std::to_string(x) + " " + std::to_string(y) + " " +
                std::to_string(x == 7 && y == 12 ? height : 0) + "\n";
      }
    }
    for (int y = 0; y < 20; ++y) {
      for (int x = 0; x < 20; ++x) {
        const int a = y * 21 + x + 1;
        text += "f " + std::to_string(a) + " " + std::to_string(a + 1) + " " +
                std::to_string(a + 22) + " " + std::to_string(a + 21) + "\n";
      }
    }
    return text;
  }
  Arguments Diff(Arguments more) const {
    Arguments arguments{"diff", store, store, "--name", "flat", "--other", "bump"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
};

}  // namespace

TEST_CASE("diff says within, exceeds or undecided by its exit status", "[cli]") {
  const Pair pair;
  CHECK(Run(pair.Diff({"--tolerance", "0.6"})).exit_code == 0);
  CHECK(Run(pair.Diff({"--tolerance", "0.4"})).exit_code == 3);
  CHECK(Run(pair.Diff({"--tolerance", "0.4", "--max-milliseconds", "0"})).exit_code == 4);
  CHECK(Run(pair.Diff({})).exit_code == 0);
  CHECK_THAT(RunOk(pair.Diff({"--tolerance", "0.6"})), Catch::Contains("within the tolerance"));
  CHECK_THAT(Run(pair.Diff({"--tolerance", "0.4"})).out,
             Catch::Contains("exceeds the tolerance") && Catch::Contains("exceeds at 7"));
  CHECK_THAT(Run(pair.Diff({"--tolerance", "0.4", "--max-milliseconds", "0"})).out,
             Catch::Contains("undecided: the time was over"));
  CHECK_THAT(RunOk({"diff", pair.store, pair.store, "--name", "flat", "--other", "flat"}),
             Catch::Contains("identical"));
}

TEST_CASE("diff tells the distance, where it is, and who asked", "[cli]") {
  const Pair pair;
  const Json json = ParseJson(Run(pair.Diff({"--tolerance", "0.4", "--json"})).out);
  CHECK(json.at("verdict") == "exceeds");
  REQUIRE(json.at("b_to_a").at("places").size() == 1);
  const Json& place = json.at("b_to_a").at("places").at(0);
  CHECK(place.at("distance").at("low") <= 0.5001);
  CHECK(place.at("distance").at("high") >= 0.4999);
  CHECK(place.at("box").at("min").at(0) < 7);
  CHECK(place.at("box").at("max").at(0) > 7);
  const Json one = RunJson(pair.Diff({"--asks", "a", "--width", "0.001"}));
  CHECK_FALSE(one.contains("b_to_a"));
  const double low = one.at("a_to_b").at("distance").at("low"),
               high = one.at("a_to_b").at("distance").at("high");
  CHECK(high - low <= 0.001);
  // A percentage is of A's diagonal: 28.28.
  CHECK(Run(pair.Diff({"--tolerance", "3%"})).exit_code == 0);
  CHECK(Run(pair.Diff({"--tolerance", "1%"})).exit_code == 3);
}

TEST_CASE("diff asks where it is told, and maps B", "[cli]") {
  const Pair pair;
  CHECK(Run(pair.Diff({"--tolerance", "0.1", "--box=9,0,-1,20,20,1"})).exit_code == 0);
  CHECK(Run(pair.Diff({"--tolerance", "0.1", "--box=6,11,-1,8,13,1"})).exit_code == 3);
  const std::string up = "--transform=1,0,0,0,0,1,0,0,0,0,1,3,0,0,0,1";
  const Json moved = RunJson(pair.Diff({up, "--width", "0.01"}));
  CHECK(moved.at("distance").at("low") <= 3.5);
  CHECK(moved.at("distance").at("high") >= 3.4);
  RunFails(1, pair.Diff({"--transform=1,0,0,0,0,1,0,0,0,0,0,0,0,0,0,1"}), {"transform", "inverse"});
  RunFails(2, pair.Diff({"--transform=1,0"}), {"--transform", "16 numbers"});
  RunFails(2, pair.Diff({"--asks", "c"}), {"--asks"});
  RunFails(2, pair.Diff({"--tolerance=-1"}), {"--tolerance"});
  RunFails(1, pair.Diff({"--csv", pair.folder.File("none/a.csv")}), {"a.csv"});
  RunFails(1, {"diff", pair.store, pair.folder.File("none.mtdb"), "--name", "flat"}, {"none.mtdb"});
}

TEST_CASE("diff writes a row for each place", "[cli]") {
  const Pair pair;
  const std::string csv = pair.folder.File("places.csv");
  CHECK(Run(pair.Diff({"--tolerance", "0.4", "--csv", csv})).exit_code == 3);
  const std::string text = ReadText(csv);
  CHECK(std::ranges::count(text, '\n') == 3);
  CHECK_THAT(text, Catch::StartsWith("of,verdict,missing,low,high,x,y,z,") &&
                       Catch::Contains("\na,exceeds,0,") && Catch::Contains("\nb,exceeds,0,"));
}

TEST_CASE("diff writes a query of the places, which extract takes", "[cli]") {
  const Pair pair;
  const std::string query = pair.folder.File("places.json"), part = pair.folder.File("part.ply");
  CHECK(Run(pair.Diff({"--tolerance", "0.6", "--places-query", query})).exit_code == 0);
  CHECK_FALSE(std::filesystem::exists(query));
  CHECK(Run(pair.Diff({"--tolerance", "0.4", "--places-query", query})).exit_code == 3);
  RunOk({"extract", pair.store, part, "--name", "bump", "--query", query});
  const TriangleMesh mesh = ReadMesh(part);
  CHECK(mesh.triangles.size() >= 4);
  CHECK(mesh.triangles.size() < 100);
  CHECK(std::ranges::any_of(mesh.positions, [](Vec3d p) { return p.z == 0.5; }));
}

TEST_CASE("diff writes a polygon for each place, and says that it is not known where they are",
          "[cli]") {
  const Pair pair;
  const std::string file = pair.folder.File("places.geojson");
  const Outcome outcome = Run(pair.Diff({"--tolerance", "0.4", "--geojson", file}));
  CHECK(outcome.exit_code == 3);
  CHECK_THAT(outcome.out, Catch::Contains("places.geojson: the coordinates are the object's own"));
  const Json json = ParseJson(ReadText(file));
  REQUIRE(json.at("features").size() == 2);
  const Json& ring = json.at("features").at(1).at("geometry").at("coordinates").at(0);
  CHECK(json.at("features").at(1).at("properties").at("of") == "b");
  CHECK(ring.size() == 5);
  CHECK(ring.at(0).at(0) < 7);
  CHECK(ring.at(2).at(0) > 7);
  CHECK(ring.at(0).at(1) < 12);
  CHECK(ring.at(2).at(1) > 12);
  CHECK(Run(pair.Diff({"--tolerance", "0.6", "--geojson", file})).exit_code == 0);
  CHECK(ParseJson(ReadText(file)).at("features").empty());
  RunFails(1, pair.Diff({"--geojson", pair.folder.File("none/a.geojson")}), {"a.geojson"});
}

TEST_CASE("diff --heights tells rise and fall, and the volumes of cut and fill", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("hills.mtdb");
  for (const auto& [name, height] : {std::pair{"may", 0.0}, {"june", 0.5}}) {
    const std::string file = folder.File(std::string(name) + ".obj");
    WriteText(file, Pair::Sheet(height));
    RunOk({"ingest", file, store, "--name", name, "--terrain"});
  }
  const auto diff = [&](Arguments more) {
    Arguments all{"diff", store, store, "--name", "may", "--other", "june", "--heights"};
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  // A pyramid over four triangles of half a square each.
  const Json json = RunJson(diff({"--width", "0", "--as-stored"}));
  CHECK(json.at("schema") == "mtdb/height_change/1");
  CHECK(json.at("fill_volume").at("low") == Approx(1.0 / 3));
  CHECK(json.at("fill_volume").at("high") == Approx(1.0 / 3));
  CHECK(json.at("cut_volume").at("high") <= 1e-9);
  CHECK(json.at("area_both").at("low") == Approx(400));
  CHECK(json.at("rise").at("height").at("low") == Approx(0.5));
  CHECK(json.at("rise").at("point") == ParseJson("[7, 12, 0.5]"));
  CHECK_FALSE(json.at("fall").contains("point"));
  CHECK(RunJson(diff({"--width", "0", "--window=0,0,7,20"})).at("fill_volume").at("high") < 0.17);
  CHECK(Run(diff({"--tolerance", "0.6"})).exit_code == 0);
  CHECK(Run(diff({"--tolerance", "0.4"})).exit_code == 3);
  CHECK(Run(diff({"--tolerance", "0.4", "--max-milliseconds", "0"})).exit_code == 4);
  CHECK_THAT(RunOk(diff({"--width", "0"})), Catch::Contains("B is above A by at most: 0.5") &&
                                                Catch::Contains("fill, above A and below B"));
  RunFails(2, diff({"--reach", "1"}), {"--reach", "--heights"});
  RunFails(2, diff({"--asks", "a"}), {"--asks", "--heights"});
  RunFails(2, diff({"--box=0,0,0,1,1,1"}), {"--heights", "--window"});
  RunFails(2, diff({"--csv", folder.File("a.csv")}), {"--csv", "--heights"});
  RunFails(2, diff({"--window=0,0,1"}), {"--window"});
  const Pair pair;
  RunFails(2, pair.Diff({"--window=0,0,1,1"}), {"--window", "--heights"});
  RunFails(1, pair.Diff({"--heights"}), {"is no terrain"});
}

TEST_CASE("diff stores the map of the distances, also into the store that it reads", "[cli]") {
  const Pair pair;
  CHECK(Run(pair.Diff({"--tolerance", "0.4", "--into", pair.store, "map"})).exit_code == 3);
  const std::string file = pair.folder.File("map.ply");
  RunOk({"extract", pair.store, file, "--name", "map"});
  const TriangleMesh mesh = ReadMesh(file);
  REQUIRE(mesh.positions.size() == 441);
  REQUIRE(mesh.header.attributes.row_bytes() == 8);
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    std::array<float, 2> interval{};
    std::memcpy(interval.data(), mesh.rows.data() + 8 * i, 8);
    const Vec3d p = mesh.positions[i];
    // Its distance from the sheet with a bump at 7, 12, whose six neighbours are flat.
    const double near = Length(p - Vec3d{7, 12, 0});
    CHECK(interval[0] <= (near < 0.1 ? 0.5 : 0.0));
    CHECK(interval[1] >= (near < 0.1 ? 0.33 : 0.0));
    CHECK(interval[1] - interval[0] <= 0.1001);
  }
  RunFails(1, pair.Diff({"--into", pair.store, "map"}), {"map"});
  RunFails(2, pair.Diff({"--into", pair.store}), {"--into"});
  RunOk({"render", pair.store, pair.folder.File("map.png"), "--name", "map", "--colour",
         "distance_high", "--size", "60x40"});
}

}  // namespace mtdb::test
