// SPDX-License-Identifier: Apache-2.0
// Paths of `mtdb follow`: keyframes into queries.
#include "tools/cli/verbs/follow_path.h"

#include <catch2/catch.hpp>

namespace mtdb::test {
namespace {

std::vector<std::string> Queries(const std::string& text) {
  const auto queries = ParseFollowPath(text);
  if (!queries.ok()) return {queries.status().message()};
  std::vector<std::string> texts;
  for (const Json& query : *queries) texts.push_back(query.Text());
  return texts;
}

TEST_CASE("a line of a path is a query or short for one", "[cli]") {
  const std::string text =
      "# comment\n\n"
      R"({"threshold": 0.5, "max_triangles": 9})"
      "\r\n"
      R"({"box": {"min": [0, 0, 0], "max": [1, 1, 1]}, "error": 0.25})"
      "\n"
      R"({"camera": {"eye": [0, -5, 0], "target": [0, 0, 0]}, "error": 2})"
      "\n"
      R"(  {"camera": {"eye": [0, -5, 0], "target": [0, 0, 0]}, "region": {"point": [1, 2, 3]}})";
  using Texts = std::vector<std::string>;
  CHECK(Queries(text) ==
        Texts{R"({"threshold":0.5,"max_triangles":9})",
              R"({"region":{"box":{"min":[0,0,0],"max":[1,1,1]}},"threshold":0.25})",
              R"({"threshold":2,"region":{"frustum":{"eye":[0,-5,0],"target":[0,0,0]}}})",
              R"({"region":{"point":[1,2,3]},"threshold":{"screen":{"camera":{"eye":[0,-5,0],)"
              R"("target":[0,0,0]},"pixels":1}}})"});
}

TEST_CASE("steps go from line to line along straight lines", "[cli]") {
  using Texts = std::vector<std::string>;
  CHECK(Queries(R"({"region": {"point": [0, 1, 2]}, "max_triangles": 10, "steps": 5}
                   {"region": {"point": [4, 1, 0]}, "max_triangles": 21, "steps": 4}
                   {"region": {"point": [4, 1, 0]}, "max_triangles": 21})") ==
        Texts{R"({"region":{"point":[0,1,2]},"max_triangles":10})",
              R"({"region":{"point":[1.0,1,1.5]},"max_triangles":13})",
              R"({"region":{"point":[2.0,1,1.0]},"max_triangles":16})",
              R"({"region":{"point":[3.0,1,0.5]},"max_triangles":18})",
              R"({"region":{"point":[4,1,0]},"max_triangles":21})",
              R"({"region":{"point":[4,1,0]},"max_triangles":21})"});
}

TEST_CASE("what is wrong with a path is told with its line", "[cli]") {
  const auto wrong = [](const std::string& text, const std::string& words) {
    INFO(text);
    CHECK_THAT(Queries(text).at(0), Catch::StartsWith(words));
  };
  wrong("", "expected a JSON object a line, found none");
  wrong("# only this\n", "expected a JSON object a line, found none");
  wrong("{}\n\nx", "line 3: expected a JSON object");
  wrong(R"({"threshold": -1})", "line 1: threshold");
  wrong(R"({"thresold": 1})", "line 1: query: no key");
  wrong(R"({"steps": 0})", "line 1: steps: expected a whole number");
  wrong(R"({"steps": 2.5})", "line 1: steps: expected a whole number");
  wrong(R"({"pixels": 2})", "line 1: pixels: needs a camera");
  wrong(R"({"camera": {"eye": [0, 0, 0]}, "pixels": 0})", "line 1: pixels: expected");
  wrong(R"({"error": 1, "threshold": 1})", "line 1: threshold: is given twice");
  wrong("{\"error\": 1}\n{\"error\": 2, \"max_triangles\": 7, \"steps\": 2}",
        "line 2: query: steps lead");
  wrong(
      "{\"region\": {\"point\": [0, 0, 0]}}\n{\"region\": {\"sphere\": {\"centre\": [0, 0, 0], "
      "\"radius\": 1}}, \"steps\": 2}",
      "line 2: sphere: steps lead");
  wrong("{\"error\": 1}\n{\"error\": 2, \"steps\": 1000000}", "line 2: more than 1000000 steps");
}

TEST_CASE("a pattern stands for the files of all steps", "[cli]") {
  CHECK(*StepFile("a/step-%03d.ply", 7) == "a/step-007.ply");
  CHECK(*StepFile("%d.glb", 1234) == "1234.glb");
  CHECK(*StepFile("s%02d.obj", 1234) == "s1234.obj");
  for (const char* bad : {"", "a.ply", "%s.ply", "%d%d.ply", "%.ply", "%3d.ply", "%00003d.ply",
                          "%d", "%d.png", "%%d.ply", "%n.ply", "%d.ply%"}) {
    INFO(bad);
    CHECK_THAT(StepFile(bad, 1).status().message(), Catch::Contains("step-%03d.ply"));
  }
}

}  // namespace
}  // namespace mtdb::test
