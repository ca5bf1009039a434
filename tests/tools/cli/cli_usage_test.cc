// SPDX-License-Identifier: Apache-2.0
// Wrong values of every option of every verb: exit status 2, one line, and nothing is touched.
#include <catch2/catch.hpp>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// Values that no option of a kind takes.
const Arguments kNoNumber{"",      "x",   "nan", "-nan", "inf", "-1",
                          "1e400", "1,5", "1m",  "0x1",  " 1",  "1e31"};
const Arguments kNoPositive{"", "x", "nan", "inf", "0", "-0", "-1", "1e400", "1e31", "1px"};
const Arguments kNoSeconds{"", "x", "nan", "inf", "-1", "1e10", "1e99", "1s"};
const Arguments kNoCount{"",
                         "x",
                         "0",
                         "-1",
                         "1.5",
                         "1e3",
                         "nan",
                         "k",
                         "0.5",
                         "1.2345.6k",
                         "1P",
                         "1KB",
                         ".5k",
                         "0.0001k",
                         "99999999999999999999",
                         "99999999999T"};
const Arguments kNoSize{"",     "x",  "0",   "-1",  "1.5",  "nan", "inf", "K",    "99999999999T",
                        "1 KB", "1P", "1.G", ".5G", "1e3M", "MB",  "1iB", "1MBB", "-1M"};
const Arguments kNoMesh{"", "a", "a.", "a.png", ".ply/", "a.ply2", "ply"};
const Arguments kNoName{""};

Arguments Lists(const std::string& good, size_t numbers) {
  Arguments wrong{"", "x", good + ",1,", good + ",x", ",", good + ";1"};
  std::string part;
  for (const char* const bad : {"nan", "inf", "1e31", "1e400", "", "x"}) {
    std::string list = bad;
    for (size_t i = 1; i < numbers; ++i) list += ",1";
    wrong.push_back(list);
  }
  return wrong;
}

struct Option {
  std::string name;
  Arguments wrong;
};

void RequireUsage(const Arguments& base, const std::vector<Option>& options) {
  for (const Option& option : options) {
    for (const std::string& value : option.wrong) {
      Arguments line = base;
      line.push_back(option.name + "=" + value);
      // "--x=" is no value at all for the parser, "--x ''" an empty one.
      if (value.empty()) {
        line.back() = option.name;
        line.push_back(value);
      }
      const Outcome outcome = Run(line);
      INFO(Join(line) << "\nexit " << outcome.exit_code << "\n" << outcome.err);
      CHECK(outcome.exit_code == 2);
      CHECK(outcome.out.empty());
      CHECK(IsOneLine(outcome.err));
    }
  }
}

const std::vector<Option> kQueryOptions{
    {"--name", kNoName},
    {"--query", kNoName},
    {"--error", kNoNumber},
    {"--error", {"%", "x%", "-1%", "nan%", "1%%", "1 %", "%1"}},
    {"--max-milliseconds", kNoNumber},
    {"--triangles", kNoCount},
    {"--max-bytes", kNoSize},
    {"--error-at",
     {"", "x", "linear", "linear,1,2,3,4", "cubic,0,0,0,1,1", "linear,0,0,0,nan,1",
      "linear,0,0,0,1e300,1", "exp,0,0,0,1,inf", "linear,0,0,0,1,1,1"}},
    {"--box", Lists("0,0,0,1,1,1", 6)},
    {"--sphere", Lists("0,0,0,1", 4)},
    {"--sphere", {"0,0,0,-1"}},
    {"--half-space", {"", "0,0,0,0,0,0", "0,0,0,1,0", "0,0,0,1,0,inf"}},
    {"--prism", {"", "0,0,1,1", "0,0,1,1,1", "0,0,1,1,1,nan"}},
    {"--wedge", {"", "0,0,0,0,40", "0,0,1,0,180", "0,0,1,0,-4", "0,0,1,0,40,-1", "0,0,1,0"}},
    {"--point", Lists("0,0,0", 3)},
    {"--segment", Lists("0,0,0,1,1,1", 6)},
    {"--tube", {"", "1", "-1,0,0,0,1,1,1", "1,0,0,0,1,1", "inf,0,0,0,1,1,1"}}};

const std::vector<Option> kCameraOptions{
    {"--pixels", kNoPositive},
    {"--eye", Lists("0,0,0", 3)},
    {"--target", Lists("0,0,0", 3)},
    {"--up", {"", "0,0,0", "0,0", "nan,0,1"}},
    {"--fov", {"", "0", "180", "-3", "nan", "inf", "x", "1e31"}},
    {"--viewport", {"", "0x3", "3", "3x", "-1x3", "3x3x3", "20000x3", "1.5x3"}}};

}  // namespace

TEST_CASE("wrong values of the options of queries are usage errors", "[cli]") {
  const Folder folder;
  const std::string none = folder.File("none.mtdb");
  const std::string out = folder.File("out.ply");
  RequireUsage({"extract", none, out}, kQueryOptions);
  RequireUsage({"extract", none, out, "--sphere", "0,0,0,1"}, {{"--error-outside", kNoNumber}});
  RequireUsage({"extract", none, out, "--frustum", "--eye=0,-1,0", "--target=0,0,0"},
               {{"--pixels", kNoPositive}});
  RequireUsage({"render", none, folder.File("a.png"), "--eye=0,-1,0"},
               {{"--target", Lists("0,0,0", 3)}, {"--target", {"0,-1,0"}}});
  RequireUsage({"render", none, folder.File("a.png"), "--target=0,0,0"},
               {{"--eye", Lists("0,0,0", 3)}});
  RequireUsage({"render", none, folder.File("a.png"), "--eye=0,-1,0", "--target=0,0,0"},
               {kCameraOptions[0],
                kCameraOptions[3],
                kCameraOptions[4],
                kCameraOptions[5],
                {"--size", kCameraOptions[5].wrong}});
  RequireUsage({"render", none, folder.File("a.png")},
               {{"--up", {"", "0,0,0", "0,0", "nan,0,1"}},
                {"--view", {"", "above", "Front"}},
                {"--background", {"", "blue", "#12345", "#12345g", "#1234567"}},
                {"--colour", {""}},
                {"--range", {"", "1", "2,1", "nan,1", "0,1,2"}}});
  RequireUsage({"render", none, folder.File("a.png"), "--eye=0,-1,0", "--target=0,0,0"},
               {{"--view", {"front"}}});
  RequireUsage({"fetch", "http://127.0.0.1:1/objects/a", out}, kQueryOptions);
  RequireUsage({"fetch", "http://127.0.0.1:1/objects/a", out},
               {{"--timeout", kNoSeconds}, {"--timeout", {"0"}}});
  CHECK_FALSE(std::filesystem::exists(none));
}

TEST_CASE("wrong names of outputs, and empty arguments, are usage errors", "[cli]") {
  const Folder folder;
  const std::string none = folder.File("none.mtdb");
  for (const std::string& name : kNoMesh) {
    RunFails(2, {"extract", none, name}, {});
    RunFails(2, {"fetch", "http://127.0.0.1:1/objects/a", name}, {});
    RunFails(2, {"generate", "terrain", name, "--triangles", "100"}, {});
    RunFails(2, {"follow", "http://127.0.0.1:1", "--path", none, "--output", name + "%d"}, {});
  }
  for (const char* const name : {"", "a.ply", "a", "png"}) RunFails(2, {"render", none, name}, {});
  const std::string png = folder.File("a.png");
  for (const Arguments& line : std::vector<Arguments>{{"extract", "", "a.ply"},
                                                      {"render", "", png},
                                                      {"info", ""},
                                                      {"list", ""},
                                                      {"verify", ""},
                                                      {"remove", none, ""},
                                                      {"remove", "", "a"},
                                                      {"probe", "", "--point", "0,0,0"},
                                                      {"serve", ""},
                                                      {"view", ""},
                                                      {"ingest", "", none},
                                                      {"ingest", "a.ply", ""},
                                                      {"fetch", "", "a.ply"},
                                                      {"follow", "", "--path", none}}) {
    RunFails(2, line, {});
  }
}

TEST_CASE("a folder in place of a file is one line, whatever is read", "[cli]") {
  const Folder folder;
  const std::string none = folder.File("none"), there = folder.File("folder.png"),
                    dem = folder.File("dem.asc"), store = folder.File("s.mtdb");
  std::filesystem::create_directory(there);
  WriteText(folder.File("folder.pgw"), "1\n0\n0\n-1\n0\n2\n");
  WriteText(dem, "ncols 3\nnrows 2\nxllcenter 0\nyllcenter 0\ncellsize 1\n1 2 3\n4 5 6\n");
  std::filesystem::create_directory(folder.File("dem.prj"));  // which is none
  RunOk({"ingest", dem, store, "--name", "t"});
  const std::vector<Arguments> commands{
      {"extract", store, none + ".ply", "--query", there},
      {"extract", store, folder.File("none.glb"), "--drape", there},
      {"probe", store, "--heights", there},
      {"follow", "http://127.0.0.1:1/objects/t", "--path", there},
      {"ingest", there, store, "--quiet"},
      {"ingest", "--terrain", there, store, "--quiet"},
      {"info", there},
      {"verify", there},
      {"serve", there, "--listen", "0"},
      {"extract", there, none + ".ply"},
      {"copy", there, none},
      {"unpack", there, none},
  };
  for (const Arguments& command : commands) {
    INFO(command[0] << " " << command[1] << " " << command[2 % command.size()]);
    const Outcome outcome = Run(command);
    INFO(outcome.err);
    CHECK((outcome.exit_code == 1 || outcome.exit_code == 2));
    CHECK(outcome.err.starts_with("mtdb: "));
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    CHECK((!std::filesystem::exists(none) && !std::filesystem::exists(none + ".ply")));
  }
}

TEST_CASE("URLs are not written to", "[cli]") {
  const Example& e = SmallExample();
  for (const std::string place : {"http://x/", "https://x/", "s3://x/"}) {
    const std::vector<Arguments> commands{
        {"extract", e.store, place + "a.ply"},
        {"render", e.store, place + "a.png"},
        {"fetch", "http://x", place + "a.ply"},
        {"generate", "terrain", place + "a.ply", "--triangles", "100"},
        {"ingest", e.mesh, place + "a.mtdb"},
        {"copy", e.store, place + "a.mtdb"},
        {"pack", e.store, place + "a.mtdbp"},
        {"unpack", e.store, place + "a.mtdb"},
        {"compact", place + "a.mtdb"},
        {"remove", place + "a.mtdb", "a"},
        {"rename", place + "a.mtdb", "a", "b"}};
    for (const Arguments& command : commands) RunFails(2, command, {place, "a URL cannot be"});
  }
}

TEST_CASE("messages tell what is wrong with numbers, and name standard output", "[cli]") {
  const Example& e = SmallExample();
  RunFails(2, {"probe", e.store, "--point", "1,2"}, {"3 numbers X,Y,Z"});
  RunFails(2, {"probe", e.store, "--point", "1,2,1e31"}, {"3 numbers X,Y,Z", "-1e30 to 1e30"});
  const Folder folder;
  const std::string said = folder.File("said");
  const std::string line =
      std::string(MTDB_BINARY) + " extract " + e.store + " - --format ply >/dev/full 2>" + said;
  CHECK(std::system(line.c_str()) != 0);
  CHECK_THAT(ReadText(said), Catch::StartsWith("mtdb: standard output: cannot be written: "));
}

TEST_CASE("wrong values of all other options are usage errors", "[cli]") {
  const Folder folder;
  const std::string none = folder.File("none.mtdb");
  const Arguments bits{"", "x", "0", "25", "-1", "1.5", "nan", "1e1"};
  const Arguments threads{"", "x", "0", "1025", "-1", "1.5", "nan"};
  Arguments memory = kNoSize;
  memory.insert(memory.end(), {"100M", "255M", "1", "268435455"});
  RequireUsage(
      {"ingest", folder.File("a.ply"), none},
      {{"--name", {"", ".", "..", "a\tb", "\xff", std::string(501, 'n')}},
       {"--bits", bits},
       {"--step", kNoPositive},
       {"--normal-bits", {"", "x", "3", "17", "-1", "nan"}},
       {"--attribute-step", {"", "x", "=1", "x=", "x=0", "x=-1", "x=nan", "x=inf", "x=1e31"}},
       {"--threads", threads},
       {"--memory", memory},
       {"--tmp", kNoName}});
  for (const char* const verb : {"info", "verify"})
    RequireUsage({verb, none}, {{"--name", kNoName}});
  RequireUsage({"verify", none}, {{"--level", {"", "none", "FAST"}}});
  RequireUsage({"probe", none, "--point", "0,0,0"},
               {{"--name", kNoName}, {"--error", kNoNumber}, {"--limit", kNoNumber}});
  RequireUsage({"probe", none}, {{"--point", Lists("0,0,0", 3)},
                                 {"--ray", Lists("0,0,0,1,1,1", 6)},
                                 {"--ray", {"0,0,0,0,0,0"}}});
  const Arguments counts{"", "x", "0", "-1", "1.5", "nan", "1000000"};
  RequireUsage(
      {"serve", none},
      {{"--listen", {"", "x", "65536", "-1", "1.2.3:80", "::1:80", "host:80", "1.2.3.4:x"}},
       {"--threads", threads},
       {"--cache", kNoSize},
       {"--max-objects", counts},
       {"--max-connections", counts},
       {"--max-sessions", counts},
       {"--max-triangles", kNoCount},
       {"--session-triangles", kNoCount},
       {"--idle", kNoSeconds},
       {"--session-idle", kNoSeconds},
       {"--timeout", kNoSeconds},
       {"--grace", kNoSeconds},
       {"--allowed-origin", kNoName},
       {"--tmp", kNoName}});
  RequireUsage({"view", none}, {{"--port", {"", "x", "0", "65536", "-1", "1.5"}}});
  RequireUsage({"follow", "http://127.0.0.1:1", "--path", none},
               {{"--remembered-vertices", {"", "x", "-1", "1.5", "16777217", "nan"}},
                {"--timeout", kNoSeconds},
                {"--reconnect", kNoSeconds},
                {"--csv", kNoName},
                {"--name", kNoName}});
  RequireUsage({"follow", "http://127.0.0.1:1"}, {{"--path", kNoName}});
  RequireUsage({"generate", "terrain", folder.File("a.ply")},
               {{"--triangles", {"", "x", "99", "-1", "20000000000", "1.5", "nan", "1e3"}}});
  RequireUsage({"generate", "terrain", folder.File("a.ply"), "--triangles", "100"},
               {{"--seed", {"", "x", "-1", "1.5", "nan", "99999999999999999999"}}});
  RunFails(2, {"generate", "cube", folder.File("a.ply"), "--triangles", "100"}, {"cube"});
  CHECK_FALSE(std::filesystem::exists(none));
}

TEST_CASE("generate writes the format that the name says", "[cli]") {
  const Folder folder;
  RunOk({"generate", "sculpture", folder.File("a.ply"), "--triangles", "500"});
  const TriangleMesh ply = ReadMesh(folder.File("a.ply"));
  for (const std::string name : {"a.obj", "b.OBJ", "a.stl", "a.off"}) {
    INFO(name);
    RunOk({"generate", "sculpture", folder.File(name), "--triangles", "500"});
    CHECK_FALSE(ReadText(folder.File(name)).starts_with("ply"));
    const TriangleMesh mesh = ReadMesh(folder.File(name));
    CHECK(mesh.triangles.size() == ply.triangles.size());
    CHECK(mesh.positions.size() == ply.positions.size());
  }
  RunOk({"generate", "terrain", folder.File("a.glb"), "--triangles", "500"});
  CHECK(ReadText(folder.File("a.glb")).starts_with("glTF"));
  RunOk({"generate", "terrain", folder.File("a.drc"), "--triangles", "500"});
  CHECK(ReadText(folder.File("a.drc")).starts_with("DRACO"));
}

}  // namespace mtdb::test
