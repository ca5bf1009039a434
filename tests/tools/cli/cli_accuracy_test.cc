// SPDX-License-Identifier: Apache-2.0
// What ingest says of the accuracy that it takes, and `info` and --dry-run before it.
#include <cstdio>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// A plane of side x side squares of `edge`, whole metres high.
std::string Terrain(int side, double edge) {
  std::string text;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      text += "v " + std::to_string(x * edge) + " " + std::to_string(y * edge) + " " +
              std::to_string((x * 7919 + y * 104729) % 997) + "\n";
    }
  }
  for (int y = 1; y < side; ++y) {
    for (int x = 1; x < side; ++x) {
      const int v = y * side + x + 1;
      const auto n = [](int i) { return " " + std::to_string(i); };
      text += "f" + n(v - side - 1) + n(v - side) + n(v) + "\nf" + n(v - side - 1) + n(v) +
              n(v - 1) + "\n";
    }
  }
  return text;
}

}  // namespace

TEST_CASE("ingest says which accuracy it chose and what it loses", "[cli]") {
  const Folder folder;
  const std::string terrain = folder.File("terrain.obj");
  const std::string store = folder.File("s.mtdb");
  WriteText(terrain, Terrain(30, 7500));
  const Json exact = RunJson({"ingest", terrain, store});
  CHECK(exact.at("step") == 1);
  CHECK(exact.at("bits") == 18);
  CHECK(exact.at("rounding_error") == 0);
  CHECK(exact.at("accuracy").at("reason") == "decimals");
  CHECK(exact.at("warnings").empty());
  CHECK_THAT(RunOk({"ingest", terrain, store, "--replace"}),
             Catch::Contains("18 bits, steps of 1, so that coordinates stay as they are written"));
  CHECK_THAT(RunOk({"ingest", terrain, store, "--replace", "--bits", "16"}),
             Catch::Contains("16 bits, steps of 3.3") && Catch::Contains("as the options say"));
  CHECK(RunOk({"ingest", terrain, store, "--replace", "--quiet"}).empty());

  const Example& example = SmallExample();
  const Json plain = RunJson({"ingest", example.mesh, store});
  CHECK(plain.at("bits") == 16);
  CHECK(plain.at("accuracy").at("reason") == "least_bits");
  CHECK(plain.at("accuracy").at("collapsed_triangles") == 0);
  // What is lost is said with numbers, and what would keep it.
  const Json coarse = RunJson({"ingest", example.mesh, store, "--bits", "6", "--name", "b"});
  const auto lost = coarse.at("accuracy").at("collapsed_triangles").get<uint64_t>();
  CHECK(lost > 0);
  REQUIRE(coarse.at("warnings").size() == 1);
  for (const std::string& words : {std::to_string(lost) + " of ", std::string("16 bits")}) {
    CHECK_THAT(coarse.at("warnings").at(0), Catch::Contains(words));
  }
  CHECK_THAT(RunOk({"ingest", example.mesh, store, "--bits", "6", "--replace"}),
             Catch::Contains("warning: " + std::to_string(lost) + " of "));
}

TEST_CASE("ingest refuses a step that leaves most triangles without area", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  for (const char* step : {"1", "1e30"}) {
    RunFails(1, {"ingest", example.mesh, store, "--quiet", "--step", step},
             {"no area", "2", "choose a smaller step", "16 bits"});
    RunFails(1, {"ingest", example.mesh, store, "--dry-run", "--step", step}, {"no area"});
  }
  CHECK(!Exists(store));
}

TEST_CASE("info tells what a mesh file is like before it is ingested, and so does --dry-run",
          "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const Json info = RunJson({"info", example.mesh});
  CHECK(info.at("triangles") == example.info.at("triangles"));
  CHECK(info.at("vertices") == example.info.at("vertices"));
  CHECK(info.at("components") == example.info.at("components"));
  CHECK(info.at("bits") == example.info.at("bits"));
  CHECK(info.at("step") == example.info.at("step"));
  const Json& edges = info.at("edges");
  CHECK(0 < edges.at("shortest"));
  CHECK(edges.at("shortest") <= edges.at("percentile_1"));
  CHECK(edges.at("percentile_1") <= edges.at("median"));
  CHECK(edges.at("median") <= edges.at("longest"));
  const double stored = example.info.at("stored_bytes").get<double>();
  CHECK(info.at("store_bytes").get<double>() == Approx(stored).epsilon(0.3));
  const std::string text = RunOk({"info", example.mesh});
  for (const char* words :
       {"component", "bounds", "edges", "16 bits", "MB in a store", "journal"}) {
    CHECK_THAT(text, Catch::Contains(words));
  }
  const Json dry = RunJson({"ingest", "--dry-run", example.mesh, store, "--bits", "12"});
  CHECK(dry.at("bits") == 12);
  CHECK(dry.at("accuracy").at("reason") == "given");
  CHECK(dry.at("accuracy").at("advised_bits") == info.at("bits"));
  CHECK(!Exists(store));
  CHECK_THAT(RunOk({"ingest", "--dry-run", example.mesh, example.store, "--replace"}),
             Catch::Contains("16 bits"));
  CHECK(RunJson({"info", example.store}).at("objects").at(0) == example.info);
  RunFails(2, {"ingest", "--dry-run", "--resume", example.mesh, store}, {"--dry-run"});
  WriteText(folder.File("broken.ply"), "ply\nformat nonsense\n");
  RunFails(1, {"info", folder.File("broken.ply")}, {"broken.ply"});
  RunFails(1, {"info", folder.File("none.ply")}, {"none.ply"});
  WriteText(folder.File("text.txt"), "no mesh, no store");
  RunFails(1, {"info", folder.File("text.txt")}, {"text.txt"});
}

TEST_CASE("the chosen accuracy does not depend on memory, threads or several files", "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  Json first;
  for (const Arguments& more :
       {Arguments{"--memory", "256M", "--threads", "1"}, Arguments{"--memory", "2G"}}) {
    Arguments ingest{"ingest", example.mesh, folder.File("s" + more[1]), "--name", "sculpture"};
    ingest.insert(ingest.end(), more.begin(), more.end());
    CHECK(RunJson(ingest).at("digest") == example.info.at("digest"));
  }
}

TEST_CASE("What lies far off is named by info, --dry-run and ingest", "[cli]") {
  const Folder folder;
  const std::string path = folder.File("far.obj");
  std::string text;
  for (int v = 0; v < 400; ++v) {
    text += "v " + std::to_string(v % 20 * 0.0517) + " " + std::to_string(v / 20 * 0.0517) + " " +
            std::to_string(v * v % 7 * 0.00123) + "\n";
  }
  for (int v = 21; v < 400; ++v) {
    if (v % 20 == 0) continue;
    text += "f " + std::to_string(v - 20) + " " + std::to_string(v - 19) + " " +
            std::to_string(v + 1) + " " + std::to_string(v) + "\n";
  }
  text += "v 5000000.123 0.456 0.789\nf 1 2 401\n";
  WriteText(path, text);
  const std::string store = folder.File("s.mtdb");
  RunFails(1, {"ingest", path, store, "--quiet"},
           {"leaves no area", "vertex 400", "5000000.12", "cut"});
  RunFails(1, {"ingest", path, store, "--quiet", "--dry-run"}, {"leaves no area", "vertex 400"});
  RunFails(1, {"ingest", path, store, "--quiet", "--bits", "1"}, {"leaves no area", "vertex 400"});
  CHECK_THAT(RunOk({"info", path}), Catch::Contains("refuses") && Catch::Contains("vertex 400"));
  const Json survey = RunJson({"info", path});
  CHECK_THAT(survey.at("refused").get<std::string>(), Catch::Contains("leaves no area"));
  CHECK(survey.at("accuracy").at("far_vertices").at("vertex") == 400);
  CHECK(survey.at("accuracy").at("flat_triangles") == 0);
}

}  // namespace mtdb::test
