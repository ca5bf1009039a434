// SPDX-License-Identifier: Apache-2.0
// mtdb follow, against `mtdb serve`.
#include <catch2/catch.hpp>

#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

TEST_CASE("follow writes the meshes that extract writes, and a table", "[cli]") {
  const ServerProcess server(TheExample().store);
  const Folder folder;
  const std::string path = folder.File("path.jsonl");
  WriteText(path, R"({"box": {"min": [-2, -2, 0], "max": [0, 2, 2]}, "error": 0.01})"
                  "\n"
                  R"({"box": {"min": [0, -2, 0], "max": [2, 2, 2]}, "error": 0.01, "steps": 3})"
                  "\n"
                  R"({"max_triangles": 700})");
  const Json result =
      RunJson({"follow", server.url() + "/objects/sculpture", "--path", path, "--output",
               folder.File("step-%02d.ply"), "--csv", folder.File("steps.csv")});
  const Json& steps = result.at("steps");
  REQUIRE(steps.size() == 5);
  std::istringstream csv(ReadText(folder.File("steps.csv")));
  std::string line;
  std::getline(csv, line);
  CHECK(line ==
        "step,query,bytes,messages,first_ms,done_ms,server_ms,triangles,vertices,insertions,"
        "removals,error_bound,limit");
  std::getline(csv, line);
  CHECK_THAT(line, Catch::StartsWith("0,," + TextOf(result.at("start_bytes")) + ",1,,"));
  for (size_t i = 0; i < 5; ++i) {
    std::getline(csv, line);
    const std::string number = std::to_string(i + 1);
    CHECK_THAT(line,
               Catch::StartsWith(number + "," + number + "," + TextOf(steps[i].at("bytes")) + ","));
    const TriangleMesh mesh = ReadMesh(folder.File("step-0" + number + ".ply"));
    CHECK(mesh.triangles.size() == steps[i].at("triangles"));
    CHECK(mesh.positions.size() == steps[i].at("vertices"));
  }
  CHECK_FALSE(std::getline(csv, line));
  const Json extracted = RunJson({"extract", TheExample().store, folder.File("x.ply"),
                                  "--box=-2,-2,0,0,2,2", "--error", "0.01"});
  CHECK(steps[0].at("triangles") == extracted.at("triangles"));
  CHECK(steps[0].at("error_bound").get<double>() ==
        Approx(extracted.at("error_bound").get<double>()).epsilon(1e-12));
  CHECK(steps[0].at("insertions").get<int>() > 0);
  CHECK(steps[4].at("removals").get<int>() > 0);
  CHECK(steps[4].at("limit") == "triangles");
  CHECK_THAT(RunOk({"follow", server.url(), "--path", path}), Catch::Contains("5 steps") &&
                                                                  Catch::Contains("base mesh") &&
                                                                  Catch::Contains("last mesh"));
}

TEST_CASE("follow says what is wrong, where", "[cli]") {
  const ServerProcess server(SmallExample().store, {"--session-triangles", "1500"});
  const Folder folder;
  const std::string path = folder.File("path.jsonl");
  WriteText(path, "{\"max_triangles\": 900}\n{\"threshold\": \"full\"}\n");
  RunFails(1, {"follow", server.url(), "--path", path}, {"step 2", "1500 triangles"});
  RunFails(1, {"follow", server.url(), "--path", folder.File("none")}, {"none", "no such file"});
  RunFails(1, {"follow", server.url(), "--path", path, "--csv", folder.File("no/x.csv")},
           {"no/x.csv"});
  RunFails(1, {"follow", "http://127.0.0.1:1", "--path", path}, {"cannot connect"});
  RunFails(1, {"follow", server.url() + "/objects/nothing", "--path", path}, {"404", "nothing"});
  RunFails(2, {"follow", server.url(), "--path", path, "--output", "x.ply"}, {"%03d"});
  RunFails(2, {"follow", "ftp://x", "--path", path}, {"ftp://x"});
  RunFails(2, {"follow", server.url()}, {"--path"});
  WriteText(path, "{\"max_triangles\": 900}\n{\"treshold\": 1}\n");
  RunFails(1, {"follow", server.url(), "--path", path}, {path, "line 2", "treshold"});
}

}  // namespace
}  // namespace mtdb::test
