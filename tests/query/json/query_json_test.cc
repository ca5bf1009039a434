// SPDX-License-Identifier: Apache-2.0
// Queries in JSON: what docs/query.md says, and what hostile texts get.
#include "query/query_json.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace mtdb::testing {
namespace {

using Json = nlohmann::json;
using Words = std::vector<std::string>;

Result<Query> Parse(const std::string& text) { return ParseQuery(text, 10); }

std::string MessageOf(const std::string& text) {
  const Result<Query> query = Parse(text);
  INFO(text);
  REQUIRE(!query.ok());
  CHECK(query.status().code() == StatusCode::kInvalidArgument);
  return query.status().message();
}

// The JSON blocks of docs/query.md.
std::vector<std::string> Documented() {
  std::ifstream in(std::string(MTDB_SOURCE_DIR) + "/docs/query.md", std::ios::binary);
  const std::string page{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  std::vector<std::string> blocks;
  const std::string begin = "```json\n";
  for (size_t at = page.find(begin); at != std::string::npos; at = page.find(begin, at)) {
    at += begin.size();
    blocks.push_back(page.substr(at, page.find("```", at) - at));
  }
  return blocks;
}

void CollectKeys(const Json& json, std::set<std::string>& keys) {
  for (const auto& [key, value] : json.items()) {
    if (json.is_object()) keys.insert(key);
    if (value.is_structured()) CollectKeys(value, keys);
  }
}

Triangle3d At(Vec3d p) { return {p, p, p}; }

}  // namespace

TEST_CASE("Every example of docs/query.md is a query, and every kind has one", "[query]") {
  const std::vector<std::string> blocks = Documented();
  CHECK(blocks.size() > 25);
  std::set<std::string> keys;
  for (const std::string& block : blocks) {
    INFO(block);
    const Result<Query> query = Parse(block);
    if (!query.ok()) FAIL_CHECK(query.status().message());
    CollectKeys(Json::parse(block), keys);
  }
  // The messages list all kinds.
  for (const std::string text : {R"({"region": {"x": 1}})", R"({"threshold": {"x": 1}})"}) {
    const std::string message = MessageOf(text);
    const size_t begin = message.find("keys ") + 5;
    std::string kinds = message.substr(begin, message.find(';') - begin) + ", ";
    CHECK(std::count(kinds.begin(), kinds.end(), ',') >= 10);
    for (size_t comma = 0; (comma = kinds.find(", ")) != std::string::npos;) {
      INFO(kinds.substr(0, comma));
      CHECK(keys.contains(kinds.substr(0, comma)));
      kinds.erase(0, comma + 2);
    }
  }
}

TEST_CASE("Regions in JSON are where they should be", "[query]") {
  const auto contains = [](const std::string& region, Vec3d p) {
    const Result<Query> query = Parse("{\"region\": " + region + "}");
    INFO(region << (query.ok() ? "" : query.status().message()));
    REQUIRE(query.ok());
    return query->region->Within(At(p), 0);
  };
  const auto check = [&](const std::string& region, Vec3d in, Vec3d out) {
    INFO(region);
    CHECK(contains(region, in));
    CHECK(!contains(region, out));
    CHECK(contains("{\"outside\": " + region + "}", out));
  };
  check(R"({"box": {"min": [0, 0, 0], "max": [1, 2, 3]}})", {1, 2, 3}, {1, 2, 3.1});
  check(R"({"sphere": {"centre": [1, 0, 0], "radius": 2}})", {-1, 0, 0}, {-1.1, 0, 0});
  check(R"({"half_space": {"point": [0, 0, 1], "normal": [0, 0, 5]}})", {9, 9, 0}, {0, 0, 1.1});
  check(R"({"polyhedron": [{"point": [0, 0, 0], "normal": [1, 0, 0]},
                           {"point": [-2, 0, 0], "normal": [-1, 0, 0]}]})",
        {-1, 9, 9}, {-3, 0, 0});
  const std::string camera = R"({"eye": [0, 0, 0], "target": [0, 5, 0], "fov": 90,
                                 "viewport": [200, 100], "near": 1, "far": 4})";
  check("{\"frustum\": " + camera + "}", {3.9, 2, 1.9}, {3.9, 2, 2.1});
  check("{\"frustum\": " + camera + "}", {0, 4, 0}, {0, 4.1, 0});
  check("{\"frustum_shadow\": " + camera + "}", {3.9, 2, 99}, {4.1, 2, 0});
  // Straight down, north is up.
  const std::string down =
      R"({"frustum": {"eye": [0, 0, 1], "target": [0, 0, 0], "fov": 90, "viewport": [200, 100]}})";
  check(down, {1.9, 0, 0}, {0, 1.9, 0});
  check(R"({"wedge": {"apex": [0, 0], "direction": [1, 0], "angle": 90, "far": 3}})",
        {2.9, 2.8, -7}, {2.9, 3, 0});
  check(R"({"prism": {"polygon": [[0, 0], [4, 0], [4, 4], [2, 1], [0, 4]], "min_z": 0}})",
        {0.5, 3, 9}, {2, 2, 1});
  check(R"({"prism": {"polygon": [[0, 0], [4, 0], [0, 4]], "max_z": 1}})", {1, 1, -9}, {1, 1, 2});
  check(R"({"point": [1, 2, 3]})", {1, 2, 3}, {1, 2, 3.001});
  check(R"({"segment": {"from": [0, 0, 0], "to": [0, 0, 4]}})", {0, 0, 2}, {0, 0, 4.1});
  check(R"({"tube": {"line": [[0, 0, 0], [2, 0, 0], [2, 2, 0]], "radius": 0.5}})", {2, 1, 0.5},
        {1, 1, 0});
  check(R"({"union": [{"point": [1, 1, 1]}, {"point": [2, 2, 2]}]})", {2, 2, 2}, {3, 3, 3});
  check(R"({"intersection": [{"sphere": {"centre": [0, 0, 0], "radius": 2}},
                             {"sphere": {"centre": [3, 0, 0], "radius": 2}}]})",
        {1.5, 0, 0}, {0, 0, 0});
}

TEST_CASE("Thresholds in JSON have the values that they should have", "[query]") {
  const auto at = [](const std::string& threshold, Vec3d p) {
    const Result<Query> query = Parse("{\"threshold\": " + threshold + "}");
    INFO(threshold << (query.ok() ? "" : query.status().message()));
    REQUIRE(query.ok());
    return query->threshold->Min(At(p), 0);
  };
  CHECK(at("0.25", {}) == 0.25);
  CHECK(at("\"full\"", {}) < 0);
  CHECK(at("\"coarsest\"", {}) > 1e300);
  CHECK(at(R"({"relative": 0.5})", {}) == 5);
  const std::string point = R"("point": [1, 0, 0], "base": 2, )";
  CHECK(at("{\"linear\": {" + point + "\"slope\": 3}}", {5, 0, 0}) == Approx(14));
  CHECK(at("{\"quadratic\": {" + point + "\"factor\": 3}}", {5, 0, 0}) == Approx(50));
  CHECK(at("{\"square_root\": {" + point + "\"factor\": 3}}", {5, 0, 0}) == Approx(8));
  CHECK(at("{\"exponential\": {" + point + "\"rate\": -0.5}}", {5, 0, 0}) ==
        Approx(2 * std::exp(-2.0)));
  CHECK(at(R"({"screen": {"camera": {"eye": [0, 0, 0], "direction": [0, 1, 0], "fov": 90,
                "viewport": [100, 100]}, "pixels": 3}})",
           {0, 5, 0}) == Approx(3 * 5 * 2.0 / 100));
  CHECK(at(R"({"by_region": {"region": {"point": [1, 1, 1]}, "inside": 1, "outside": 2}})",
           {1, 1, 1}) == 1);
  CHECK(at(R"({"grid": {"origin": [0, 0, 0], "cell": [1, 1, 1], "counts": [2, 1, 2],
                "errors": [1, 2, 3, 4]}})",
           {0.5, 0.5, 9}) == 3);
  CHECK(at(R"({"smallest": [3, 2]})", {}) == 2);
  CHECK(at(R"({"largest": [3, 2]})", {}) == 3);
}

TEST_CASE("What is wrong with a query is said with its place", "[query]") {
  const std::vector<std::pair<std::string, Words>> wrong{
      {"", {"byte", "not JSON"}},
      {"{\"region\":", {"byte 11", "not JSON"}},
      {"[]", {"query", "an object", "region", "found a list of 0"}},
      {"{\"reigon\": 1}", {"query", "\"reigon\"", "region, threshold"}},
      {"{\"\xff\": 1}", {"byte"}},
      {"{\"region\": 7}", {"region:", "box", "found 7"}},
      {R"({"region": {"ball": {}}})", {"region:", "sphere", "\"ball\""}},
      {R"({"region": {"box": {}, "sphere": {}}})", {"region:", "2 keys"}},
      {R"({"region": {"box": {"min": [0, 0, 0]}}})", {"region.box:", "\"max\"", "missing"}},
      {R"({"region": {"box": {"min": [0, 0], "max": [1, 1, 1]}}})",
       {"region.box.min:", "[x, y, z]", "a list of 2"}},
      {R"({"region": {"box": {"min": [0, 0, "a"], "max": [1, 1, 1]}}})",
       {"region.box.min[2]:", "a number", "\"a\""}},
      {R"({"region": {"box": {"min": [0, 0, 2], "max": [1, 1, 1]}}})", {"region.box:", "exceed"}},
      {R"({"region": {"union": [{"point": [0, 0, 0]}, {"sphere": {"centre": [0, 0, 0], "radius": -4}}]}})",
       {"region.union[1].sphere.radius:", "not negative", "-4"}},
      {R"({"region": {"union": []}})", {"region.union:", "at least 1", "a list of 0"}},
      {R"({"region": {"point": [1e31, 0, 0]}})", {"region.point[0]:", "1e30"}},
      {R"({"region": {"point": [1e999, 0, 0]}})", {"too large"}},
      {R"({"region": {"half_space": {"point": [0, 0, 0], "normal": [0, 0, 0]}}})",
       {"region.half_space.normal:", "without length"}},
      {R"({"region": {"frustum": {"eye": [0, 0, 0]}}})", {"region.frustum:", "target"}},
      {R"({"region": {"frustum": {"eye": [0, 0, 0], "target": [0, 0, 0]}}})",
       {"region.frustum.target:", "eye"}},
      {R"({"region": {"frustum": {"eye": [0, 0, 0], "direction": [0, 0, 1], "up": [0, 0, 2]}}})",
       {"region.frustum:", "up"}},
      {R"({"region": {"frustum": {"eye": [0, 0, 0], "target": [0, 1, 0], "fov": 180}}})",
       {"region.frustum.fov:", "180"}},
      {R"({"region": {"frustum": {"eye": [0, 0, 0], "target": [0, 1, 0], "viewport": [10, 1.5]}}})",
       {"region.frustum.viewport[1]:", "1.5"}},
      {R"({"region": {"frustum": {"eye": [0, 0, 0], "target": [0, 1, 0], "near": 2, "far": 1}}})",
       {"region.frustum.far:", "above near"}},
      {R"({"region": {"frustum_shadow": {"eye": [0, 0, 0], "target": [0, 1, 0]}}})",
       {"region.frustum_shadow:", "\"far\""}},
      {R"({"region": {"wedge": {"apex": [0, 0], "direction": [0, 0], "angle": 20}}})",
       {"region.wedge.direction:"}},
      {R"({"region": {"prism": {"polygon": [[0, 0], [1, 1]]}}})", {"region.prism.polygon:", "3"}},
      {R"({"region": {"prism": {"polygon": [[0, 0], [1, 1], [2, 1]], "min_z": 1, "max_z": 0}}})",
       {"region.prism:", "min_z"}},
      {R"({"region": {"tube": {"line": [], "radius": 1}}})", {"region.tube.line:", "at least 1"}},
      {R"({"threshold": -1})", {"threshold:", "not negative"}},
      {R"({"threshold": "fine"})", {"threshold:", "\"full\"", "\"fine\""}},
      {R"({"threshold": {"linear": {"point": [0, 0, 0], "base": 1}}})",
       {"threshold.linear:", "\"slope\""}},
      {R"({"threshold": {"screen": {"camera": {"eye": [0, 0, 0], "target": [0, 1, 0]}, "pixels": 0}}})",
       {"threshold.screen.pixels:", "above 0"}},
      {R"({"threshold": {"grid": {"origin": [0, 0, 0], "cell": [1, 1, 1], "counts": [1000000000,
           1000000000, 1000000000], "errors": [1]}}})",
       {"threshold.grid.errors:", "each cell", "a list of 1"}},
      {R"({"threshold": {"grid": {"origin": [0, 0, 0], "cell": [1, 0, 1], "counts": [1, 1, 1],
           "errors": [1]}}})",
       {"threshold.grid.cell[1]:", "above 0"}},
      {R"({"max_triangles": 0})", {"max_triangles:", "above 0"}},
      {R"({"clip": 1})", {"clip:", "true or false"}},
      {R"({"clip": true})", {"clip:", "region"}},
  };
  for (const auto& [text, words] : wrong) {
    const std::string message = MessageOf(text);
    for (const std::string& word : words) CHECK_THAT(message, Catch::Contains(word));
    CHECK(message.find('\n') == std::string::npos);
  }
}

TEST_CASE("Parts of queries are read by themselves", "[query]") {
  const Result<RegionPtr> region = ParseRegion(R"({"sphere": {"centre": [1, 0, 0], "radius": 2}})");
  REQUIRE(region.ok());
  CHECK((*region)->Within(At({3, 0, 0}), 0));
  CHECK(!(*region)->Within(At({3.1, 0, 0}), 0));
  const Result<ThresholdPtr> threshold = ParseThreshold(R"({"relative": 0.5})", 4);
  REQUIRE(threshold.ok());
  CHECK((*threshold)->constant() == 2);
  const Result<Camera> camera = ParseCamera(R"({"eye": [1, 2, 3], "target": [1, 4, 3], "far": 9})");
  REQUIRE(camera.ok());
  CHECK(camera->eye == Vec3d{1, 2, 3});
  CHECK(camera->far == 9);
  for (const std::string text : {"", "{", "7e999", "[]", "{\"x\": 1}", "\"\xff\""}) {
    INFO(text);
    for (const Status& status : {ParseRegion(text).status(), ParseThreshold(text, 1).status(),
                                 ParseCamera(text).status()}) {
      CHECK(status.code() == StatusCode::kInvalidArgument);
      CHECK(!status.message().empty());
    }
  }
  CHECK_THAT(ParseCamera("{}").status().message(), Catch::StartsWith("camera: "));
}

TEST_CASE("Hostile queries are refused and crash nothing", "[query]") {
  const auto repeated = [](const std::string& text, int times) {
    std::string all;
    for (int i = 0; i < times; ++i) all += text;
    return all;
  };
  CHECK_THAT(MessageOf(repeated("[", 1000000)), Catch::Contains("byte 64"));
  CHECK_THAT(MessageOf("{\"region\": " + repeated("{\"outside\":", 100)), Catch::Contains("64"));
  std::string planes = repeated(R"({"point": [0, 0, 0], "normal": [0, 0, 1]},)", 65);
  planes.pop_back();
  CHECK_THAT(MessageOf("{\"region\": {\"polyhedron\": [" + planes + "]}}"), Catch::Contains("64"));
  CHECK_THAT(MessageOf("{\"" + repeated("k", 100000) + "\": 1}"), Catch::Contains("..."));
  // Regions within regions, as deep as may be: an answer takes no longer for it.
  std::string deep = R"({"tube": {"line": [[0, 0, 0], [1, 0, 0], [1, 1, 0]], "radius": 0.3}})";
  for (int i = 0; i < 19; ++i) {
    deep = std::string(i % 2 ? R"({"union")" : R"({"intersection")") + ": [{\"outside\": " + deep +
           R"(}, {"sphere": {"centre": [0.5, 0, 0.1], "radius": 0.4}}]})";
  }
  const Result<Query> nested = Parse("{\"region\": " + deep + "}");
  REQUIRE(nested.ok());
  for (int i = 0; i < 100; ++i) {
    const double x = 0.02 * i - 0.5;
    const Triangle3d t{Vec3d{x, 0, 0}, Vec3d{x + 0.5, 0, 0}, Vec3d{x, 0.5, 0.2}};
    CHECK(nested->region->Within(t, 0.1) >= nested->region->Within(t, 0));
  }
  // Valid, though odd: huge and tiny numbers, flat and empty regions.
  for (const std::string region :
       {R"({"tube": {"line": [[1e30, -1e30, 1e30], [-1e30, 1e30, 1e30]], "radius": 1e30}})",
        R"({"polyhedron": [{"point": [1e30, 0, 0], "normal": [1e-30, 1e-30, 0]},
                           {"point": [0, 0, 0], "normal": [1e30, 0, 1e-30]}]})",
        R"({"prism": {"polygon": [[1, 1], [1, 1], [1, 1]]}})",
        R"({"frustum": {"eye": [1e30, 0, 0], "target": [0, 0, 0], "fov": 179}})"}) {
    const Result<Query> query = Parse("{\"region\": " + region + "}");
    INFO(region);
    REQUIRE(query.ok());
    const Triangle3d t{Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}};
    CHECK(query->region->Within(t, 1) <= query->region->BoxWithin({{0, 0, 0}, {1, 1, 0}}, 1));
  }
  // Documented queries with a byte changed or cut off: an error or a query, never more.
  std::mt19937 random(5);
  int refused = 0;
  const std::vector<std::string> blocks = Documented();
  for (int i = 0; i < 3000; ++i) {
    std::string text = blocks[random() % blocks.size()];
    if (i % 3 == 0) {
      text.resize(random() % text.size());
    } else {
      static constexpr char kBytes[] = "{}[]\",:-.0123456789etrue\xff\n";
      text[random() % text.size()] = kBytes[random() % (sizeof(kBytes) - 1)];
    }
    const Result<Query> query = Parse(text);
    refused += !query.ok();
    if (!query.ok()) CHECK(!query.status().message().empty());
  }
  CHECK(refused > 1000);
}

}  // namespace mtdb::testing
