// SPDX-License-Identifier: Apache-2.0
// What mtdb says to people: of inputs that are none, numbers, pipes that close, and nothing.
#include <catch2/catch.hpp>
#include <cmath>
#include <csignal>
#include <unistd.h>

#include "tests/tools/cli_testing.h"
#include "tools/c/mtdb_write.h"

namespace mtdb::test {
namespace {

const std::string kPng("\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\2\0\0\0\2\x08\2\0\0\0", 29);
const std::string kJpeg("\xff\xd8\xff\xe0\0\x10JFIF\0", 11);

// What a command says on standard error, and its exit status.
Outcome Shell(const Folder& folder, const std::string& command) {
  Outcome outcome;
  const int status = std::system(
      ("bash -c \"set -o pipefail; " + command + "\" 2> '" + folder.File("err") + "'").c_str());
  outcome.exit_code = WEXITSTATUS(status);
  outcome.err = ReadText(folder.File("err"));
  return outcome;
}

TEST_CASE("a picture is no mesh, whatever is in the store", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  // As an object is called.
  const std::string png = folder.File("sculpture.png"), jpeg = folder.File("photo");
  WriteText(png, kPng);
  WriteText(jpeg, kJpeg);
  for (const std::string& picture : {png, jpeg}) {
    RunFails(1, {"ingest", picture, example.store}, {picture, "is a picture", "--drape"});
    RunFails(1, {"ingest", example.mesh, picture, folder.File("s.mtdb")}, {"is a picture"});
    RunFails(1, {"ingest", picture, folder.File("s.mtdb"), "--dry-run"}, {"is a picture"});
    RunFails(1, {"info", picture}, {picture, "is a picture"});
  }
  CHECK(!Exists(folder.File("s.mtdb")));
}

TEST_CASE("a file that is no store is not damaged, but something else", "[cli]") {
  const Folder folder;
  const std::string png = folder.File("picture.png");
  WriteText(png, kPng + std::string(20000, 'x'));
  RunFails(1, {"verify", png}, {png, "no file of mtdb", "a PNG picture"});
  RunFails(1, {"list", png}, {png, "a PNG picture"});
  RunFails(1, {"verify", SmallExample().mesh}, {"no file of mtdb", "mtdb ingest"});
}

TEST_CASE("a file of mtdb is no mesh", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb"), packed = folder.File("a.mtdbp");
  RunFails(1, {"ingest", example.store, store}, {example.store, "an mtdb store", "mtdb copy"});
  RunFails(1, {"ingest", example.store, store, "--dry-run"}, {"mtdb extract"});
  RunOk({"pack", example.store, packed});
  RunFails(1, {"ingest", packed, store}, {packed, "a packed file", "mtdb unpack"});
  CHECK(!Exists(store));
}

TEST_CASE("a picture that says nowhere where it lies is told so, with and without GDAL", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string png = folder.File("photo.png");
  WriteText(png, kPng);
  for (const Arguments& verb :
       std::vector<Arguments>{{"extract", example.store, folder.File("out.glb"), "--drape", png},
                              {"render", example.store, folder.File("out.png"), "--drape", png}}) {
    const Outcome outcome = Run(verb);
    CHECK(outcome.exit_code == 1);
    CHECK_THAT(outcome.err, Catch::Contains("photo.pgw") && !Catch::Contains("GDAL"));
  }
}

TEST_CASE("a pipe that closes is no full disk", "[cli]") {
  const Example& example = TheExample();
  const Folder folder;
  const std::string mtdb = std::string("'") + MTDB_BINARY + "' ";
  for (const std::string& command :
       {"extract '" + example.store + "' - --format ply",
        "extract '" + example.store + "' - --format obj", "info '" + example.store + "' --json",
        std::string("help ingest")}) {
    CAPTURE(command);
    // The reader is gone before the first byte, or after it.
    for (const char* const reader : {"true", "head -c 1 > /dev/null"}) {
      CHECK(Shell(folder, "(sleep 0.05; " + mtdb + command + ") | " + reader).err == "");
    }
  }
  const Outcome full = Shell(folder, mtdb + "info '" + example.store + "' > /dev/full");
  CHECK(full.exit_code == 1);
  CHECK_THAT(full.err, Catch::Contains("disk full"));
}

TEST_CASE("numbers in texts are grouped and counted, those in JSON are not", "[cli]") {
  const Example& example = TheExample();
  const std::string text = RunOk({"info", example.store});
  std::string triangles = std::to_string(example.info.at("triangles").get<uint64_t>());
  triangles.insert(triangles.size() - 3, ",");
  CHECK_THAT(text, Catch::Contains(triangles + " triangles") && Catch::Contains(", 1 component,") &&
                       Catch::Contains(", 1 object\n"));
  const Folder folder;
  CHECK_THAT(RunOk({"extract", example.store, folder.File("out.ply")}),
             Catch::Contains(triangles + " triangles"));
  WriteText(folder.File("one.off"), "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
  CHECK_THAT(RunOk({"ingest", folder.File("one.off"), folder.File("s.mtdb")}),
             Catch::Contains("one: 1 triangle, 3 vertices, 1 component, 3 border edges\n"));
  CHECK_THAT(RunOk({"info", folder.File("one.off")}), Catch::Contains("1 triangle, 3 vertices"));
}

TEST_CASE("an index of -1 is called so", "[cli]") {
  const Folder folder;
  mtdb_database* database = nullptr;
  mtdb_error error{};
  REQUIRE(mtdb_open_writable(folder.File("s.mtdb").c_str(), &database, &error) == MTDB_OK);
  const double positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const uint64_t indices[3] = {0, 1, static_cast<uint64_t>(-1)};
  mtdb_input input;
  MTDB_INIT(input);
  input.vertices = 3;
  input.triangles = 1;
  input.positions = positions;
  input.indices_long = indices;
  CHECK(mtdb_ingest_arrays(database, "x", &input, nullptr, nullptr, &error) == MTDB_BAD_INPUT);
  CHECK_THAT(error.message, Catch::Contains("vertex index -1,"));
  mtdb_free_database(database);
}

TEST_CASE("--quiet leaves errors, JSON and meshes", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const auto silent = [](const Arguments& arguments) {
    const Outcome outcome = Run(arguments);
    INFO(Join(arguments) << "\n" << outcome.out << outcome.err);
    CHECK(outcome.exit_code == 0);
    CHECK(outcome.out.empty());
    CHECK(outcome.err.empty());
  };
  const std::string ply = folder.File("a.ply"), copy = folder.File("c.mtdb");
  silent({"extract", example.store, ply, "--quiet"});
  silent({"render", example.store, folder.File("a.png"), "--quiet", "--size", "40x30", "--draft"});
  for (const char* const verb : {"info", "list", "verify"})
    silent({verb, example.store, "--quiet"});
  silent({"probe", example.store, "--point", "0,0,0", "--quiet"});
  silent({"copy", example.store, copy, "--quiet"});
  silent({"rename", copy, "sculpture", "other", "--quiet"});
  silent({"compact", copy, "--quiet"});
  silent({"pack", copy, folder.File("p.mtdbp"), "--quiet"});
  silent({"remove", copy, "other", "--quiet"});
  silent({"unpack", folder.File("p.mtdbp"), copy, "--quiet"});
  silent({"generate", "terrain", folder.File("t.ply"), "--triangles", "200", "--quiet"});
  const Outcome mesh = Run({"extract", example.store, "-", "--format", "ply", "--quiet"});
  CHECK(mesh.out == ReadText(ply));
  CHECK(mesh.err.empty());
  CHECK(RunJson({"info", example.store, "--quiet"}) == RunJson({"info", example.store}));
  RunFails(1, {"info", example.store, "--quiet", "--name", "nobody"}, {"nobody"});
}

TEST_CASE("render writes JPEG, too", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const Arguments small{"--size", "64x48", "--draft"};
  for (const char* const name : {"a.jpg", "a.JPEG"}) {
    Arguments render{"render", example.store, folder.File(name)};
    render.insert(render.end(), small.begin(), small.end());
    RunOk(render);
    const std::string bytes = ReadText(folder.File(name));
    CHECK(bytes.starts_with("\xff\xd8\xff"));
    CHECK(bytes.ends_with("\xff\xd9"));
    render.insert(render.end(), {"--background", "transparent"});
    RunFails(1, render, {"JPEG has no transparency"});
  }
  RunFails(2, {"render", example.store, folder.File("a.gif")}, {".png, .jpg or .jpeg"});
}

TEST_CASE("view listens where it is told", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  RunFails(2, {"view", example.store, "--listen", "nowhere"}, {"--listen"});
  RunFails(2, {"view", example.store, "--listen", "127.0.0.1:0", "--port", "8000"}, {"--listen"});
  const std::string out = folder.File("out");
  const pid_t view = Start({"view", example.store, "--no-browser", "--listen", "127.0.0.2:0"}, out,
                           folder.File("err"));
  while (ReadText(out).find('\n') == std::string::npos && ::waitpid(view, nullptr, WNOHANG) == 0) {
    ::usleep(20'000);
  }
  if (ReadText(folder.File("err")).find("built without the viewer") != std::string::npos) {
    WARN("skipped: no viewer in this build");
    return;
  }
  CHECK_THAT(ReadText(out), Catch::StartsWith("http://127.0.0.2:"));
  ::kill(view, SIGTERM);
  CHECK(Finish(view).exit_code == 0);
}

TEST_CASE("heights that are no decimals get a step, and it is told", "[cli]") {
  const Folder folder;
  const std::string file = folder.File("waves.asc"), store = folder.File("s.mtdb");
  std::string text = "ncols 40\nnrows 30\nxllcorner 0\nyllcorner 0\ncellsize 1\n";
  double least = 1e9, most = -1e9;
  for (int r = 0; r < 30; ++r) {
    for (int c = 0; c < 40; ++c) {
      const double height = 50 * std::sin(0.2 * c) * std::cos(0.17 * r);
      least = std::min(least, height);
      most = std::max(most, height);
      char number[40];
      std::snprintf(number, sizeof(number), "%.14f ", height);
      text += number;
    }
    text += "\n";
  }
  WriteText(file, text);
  const Json info = RunJson({"info", file});
  CHECK(info.at("height_step_reason") == "chosen");
  const double step = info.at("height_step");
  CHECK(step <= (most - least) / 500);
  CHECK(step > (most - least) / 50000);
  CHECK_THAT(RunOk({"info", file}), Catch::Contains("steps of ") && Catch::Contains("neighbours"));
  const Json said = RunJson({"ingest", file, store});
  CHECK(said.at("raster_input").at("height_step") == step);
  CHECK(said.at("raster_input").at("height_step_reason") == "chosen");
  CHECK(said.at("rounding_error") <= step / 2 * 1.001);
  CHECK_THAT(TextOf(said.at("notes")), Catch::Contains("--height-step"));
  const Json given = RunJson({"ingest", file, store, "--replace", "--height-step", "0.5"});
  CHECK(given.at("raster_input").at("height_step_reason") == "given");
}

}  // namespace
}  // namespace mtdb::test
