// SPDX-License-Identifier: Apache-2.0
// What mtdb says of its verbs, all of them as `mtdb help` lists them.
#include <catch2/catch.hpp>
#include <map>
#include <sstream>
#include <string>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// All verbs, as `mtdb help` lists them: a line each behind "Verbs:", with the verb first.
const Arguments& Verbs() {
  static const Arguments kVerbs = [] {
    Arguments verbs;
    const std::string help = RunOk({"help"});
    std::istringstream lines(help.substr(help.find("\nVerbs:\n") + 8));
    for (std::string line; std::getline(lines, line) && (line.empty() || line[0] == ' ');) {
      const bool names = line.size() > 2 && line.starts_with("  ") && line[2] != ' ';
      if (names) verbs.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
    return verbs;
  }();
  return kVerbs;
}

TEST_CASE("every verb explains itself and all its options", "[cli]") {
  const std::map<std::string, Arguments> options{
      {"ingest",
       {"INPUT... STORE", "--name",   "--format",  "--bits",    "--step",    "--lossless", "--weld",
        "--no-weld",      "--orient", "--up",      "--units",   "--threads", "--memory",   "--tmp",
        "--max-tmp",      "--resume", "--replace", "--dry-run", "--quiet",   "--json"}},
      {"info", {"STORE", "--name", "--format", "--json"}},
      {"list", {"STORE", "--json"}},
      {"extract",
       {"STORE OUTPUT",
        "--name",
        "--full",
        "--error E",
        "--pixels P",
        "--error-at",
        "--error-outside E",
        "--triangles N",
        "--max-bytes",
        "--max-milliseconds",
        "--normals",
        "--box",
        "--sphere",
        "--half-space",
        "--prism",
        "--wedge",
        "--point",
        "--segment",
        "--tube",
        "--frustum",
        "--intersect",
        "--outside",
        "--clip",
        "--eye",
        "--target",
        "--up",
        "--fov",
        "--viewport",
        "--query FILE",
        "--print-query",
        "--json",
        ".ply .obj .stl .off .glb .drc"}},
      {"verify", {"STORE", "--name", "--level", "fast", "full", "global", "--json"}},
      {"render",
       {"STORE OUT.png", "--name", "--full", "--error E", "--triangles N", "--box", "--sphere",
        "--tube", "--frustum", "--clip", "--eye", "--query FILE", "--size", "1200x900",
        "--overview", "--wireframe", "--json"}},
      {"probe", {"STORE", "--name", "--point X,Y,Z", "--ray", "--error E", "--limit D", "--json"}},
      {"serve",
       {"STORE", "--listen", "127.0.0.1:8080", "--threads", "--cache SIZE", "--max-objects",
        "--max-sessions", "--max-triangles", "--idle", "--timeout", "--grace", "--tmp", "curl"}},
      {"view", {"STORE", "--port N", "--no-browser  ", "xdg-open", "mtdb serve"}},
      {"fetch",
       {"URL OUTPUT", "--name", "--error E", "--box", "--clip", "--query FILE", "--normals",
        "--timeout", "--json", "http://localhost:8080/objects/statue"}},
      {"tile",
       {"STORE OUTPUT",
        "--name",
        "--as FORMAT",
        "3dtiles",
        "quantized-mesh",
        "terrain-rgb",
        "neuroglancer",
        "--at LON,LAT,HEIGHT",
        "--pixels P",
        "--tile-triangles N",
        "--mercator",
        "--max-level N",
        "--encoding NAME",
        "--tile-pixels N",
        "--ids LIST",
        "--resolution X,Y,Z",
        "--bits N",
        "--sharded",
        ".3tz",
        ".pmtiles",
        "--threads",
        "--memory",
        "--tmp",
        "--replace",
        "--json",
        "docs/tiles.md"}},
      {"remove", {"STORE NAME"}},
      {"rename", {"STORE OLD NEW"}},
      {"copy", {"STORE TARGET", "--replace", "backup.mtdb"}},
      {"compact", {"STORE"}},
      {"pack", {"STORE FILE", "--name", "docs/packed.md"}},
      {"unpack", {"FILE STORE", "--name", "--replace"}},
      {"profile", {"STORE", "--line", "--error"}},
      {"diff",
       {"A B", "--name", "--other NAME", "--tolerance T", "--width W", "--reach R",
        "--max-milliseconds", "--asks WHOSE", "--transform M", "--as-stored", "--box", "--outside",
        "--csv FILE", "--places-query FILE", "--into STORE NAME", "--json", "3 exceeds",
        "4 undecided"}},
      {"follow", {"URL", "--path", "--output", "--csv", "--reconnect", "docs/protocol.md"}},
      {"generate", {"SHAPE OUTPUT", "sculpture", "terrain", "sheets", "--triangles", "--seed"}}};
  const std::string overview = RunOk({"help"});
  CHECK(overview == RunOk({"--help"}));
  CHECK(Verbs().size() == options.size());
  for (const std::string& verb : Verbs()) {
    INFO(verb);
    REQUIRE(options.contains(verb));
    CHECK_THAT(overview, Catch::Contains("  " + verb + " "));
    const std::string help = RunOk({"help", verb});
    CHECK(help == RunOk({verb, "--help"}));
    CHECK_THAT(help, Catch::Contains("Usage: mtdb " + verb + " ") && Catch::Contains("--quiet"));
    for (const std::string& option : options.at(verb)) CHECK_THAT(help, Catch::Contains(option));
  }
  CHECK_THAT(RunOk({"--version"}), Catch::StartsWith("mtdb 0."));
  const Outcome bare = Run({});
  CHECK(bare.exit_code == 2);
  CHECK(bare.out.empty());
  CHECK(bare.err == overview);
}

TEST_CASE("every verb refuses options that it has not, and nothing at all", "[cli]") {
  for (const std::string& verb : Verbs()) {
    RunFails(2, {verb, "--paint"}, {"mtdb help " + verb});
    RunFails(2, {verb}, {"required", "mtdb help " + verb});
  }
}

}  // namespace
}  // namespace mtdb::test
