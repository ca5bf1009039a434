// Queries in JSON: what docs/query.md says, what hostile files get, and the options' queries.
#include "tools/internal/query_json.h"

#include <catch2/catch.hpp>
#include <functional>
#include <random>
#include <set>

#include "tests/tools/cli_testing.h"
#include "tools/internal/query_options.h"

namespace mtdb::test {
namespace {

Result<Query> Parse(const std::string& text, double diagonal = 10) {
  MTDB_ASSIGN_OR_RETURN(const QueryJson json, ParseQueryText(text));
  return QueryFromJson(json, diagonal);
}

std::string MessageOf(const std::string& text) {
  const Result<Query> query = Parse(text);
  INFO(text);
  REQUIRE(!query.ok());
  CHECK(query.status().code() == StatusCode::kInvalidArgument);
  return query.status().message();
}

// The JSON blocks of docs/query.md.
std::vector<std::string> Documented() {
  const std::string page = ReadText(std::string(MTDB_SOURCE_DIR) + "/docs/query.md");
  std::vector<std::string> blocks;
  const std::string begin = "```json\n";
  for (size_t at = page.find(begin); at != std::string::npos; at = page.find(begin, at)) {
    at += begin.size();
    blocks.push_back(page.substr(at, page.find("```", at) - at));
  }
  return blocks;
}

void CollectKeys(const QueryJson& json, std::set<std::string>& keys) {
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
    CollectKeys(QueryJson::parse(block), keys);
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
    const Result<Query> query = Parse("{\"threshold\": " + threshold + "}", 10);
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
  const std::vector<std::pair<std::string, Arguments>> wrong{
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
      {R"({"region": {"frustum": {"eye": [0, 0, 0], "direction": [0, 0, 1]}}})",
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

TEST_CASE("Options stand for the queries that the page says", "[query][cli]") {
  const auto printed = [](Arguments options) {
    options.insert(options.begin(), {"extract", "no.mtdb", "out.ply"});
    options.push_back("--print-query");
    return Json::parse(RunOk(options));
  };
  const Json full = {{"threshold", "full"}};
  CHECK(printed({}) == full);
  // "... `--option value`" before a block, and the block: the same query.
  const std::string page = ReadText(std::string(MTDB_SOURCE_DIR) + "/docs/query.md");
  int compared = 0;
  for (size_t at = 0; (at = page.find("`--", at)) != std::string::npos; ++at) {
    const size_t end = page.find('`', at + 1);
    const size_t block = page.find("```json\n", end);
    if (page.substr(end, 2) != "`\n" || block != end + 3) continue;
    Arguments options;
    std::string text = page.substr(at + 1, end - at - 1);
    for (size_t space = 0; space != std::string::npos; text.erase(0, space + 1)) {
      space = text.find(' ');
      options.push_back(text.substr(0, space));
      if (space == std::string::npos) break;
    }
    INFO(Join(options));
    Json expected = Json::parse(page.substr(block + 8, page.find("```", block + 8) - block - 8));
    Json found = printed(options);
    // The page leaves out what goes without saying, and shows what has no option.
    if (!expected.contains("threshold")) expected["threshold"] = "full";
    for (Json* json : {&expected, &found}) {
      Json flat = json->flatten();
      for (const char* key : {"min_z", "max_z", "near", "viewport/0", "viewport/1"}) {
        for (auto it = flat.begin(); it != flat.end();) {
          it = it.key().ends_with(std::string("/") + key) ? flat.erase(it) : std::next(it);
        }
      }
      *json = flat;
    }
    CHECK(expected == found);
    ++compared;
  }
  CHECK(compared >= 15);
}

TEST_CASE("A query from a file gives the answer of its options", "[query][cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string file = folder.File("query.json");
  const std::string out = folder.File("out.ply");
  const auto bounds = [&](const char* end, size_t axis) {
    return example.info.at("bounds").at(end).at(axis).get<double>();
  };
  const std::string eye = std::to_string(bounds("min", 0) - 2) + ",0,0.5";
  const std::vector<Arguments> all{
      {"--sphere", "0,0,0,0.5", "--error-rel", "0.001"},
      {"--half-space=0,0,0,-1,0,0", "--tube=0.2,0,0,-9,0,0,9", "--intersect", "--clip"},
      {"--box=-1,-1,-1,0,0,0", "--point=1,1,1", "--outside", "--error", "0.01", "--clip"},
      {"--wedge=0,0,1,0,60", "--error", "0.005", "--error-outside", "0.1"},
      {"--prism=0,0,1,0,0,1", "--segment=0,0,0,1,1,1", "--error-at", "exp,0,0,0,0.001,2"},
      {"--eye=" + eye, "--target=0,0,0", "--frustum", "--pixels", "3", "--fov", "30"},
      {"--eye=" + eye, "--target=0,0,0", "--pixels", "3", "--viewport", "300x200"},
      {"--triangles", "500", "--sphere=0,0,0,1"},
  };
  std::set<uint64_t> sizes;
  for (const Arguments& options : all) {
    INFO(Join(options));
    Arguments arguments{"extract", example.store, out};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Json direct = RunJson(arguments);
    arguments.push_back("--print-query");
    WriteText(file, RunOk(arguments));
    const Json from_file = RunJson({"extract", example.store, out, "--query", file});
    for (const char* key : {"triangles", "vertices", "nodes_applied", "error_bound"}) {
      CHECK(direct.at(key) == from_file.at(key));
    }
    CHECK(direct.at("triangles") < example.info.at("triangles"));
    sizes.insert(direct.at("triangles").get<uint64_t>());
  }
  CHECK(sizes.size() == all.size());
  // Render draws what the camera sees, or everything.
  const std::string picture = folder.File("a.png");
  const Arguments render{"render", example.store,  picture,         "--size",
                         "40x30",  "--eye=" + eye, "--target=0,0,0"};
  RunOk(render);
  const std::string seen = ReadText(picture);
  Arguments overview = render;
  overview.push_back("--overview");
  RunOk(overview);
  CHECK(ReadText(picture) != seen);
  RunOk({"render", example.store, picture, "--size", "40x30"});
  const std::string plain = ReadText(picture);
  RunOk(overview);
  CHECK(ReadText(picture) == plain);
}

TEST_CASE("Options and files that make no query are refused", "[query][cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const auto fails = [&](int code, const Arguments& options, const Arguments& words) {
    Arguments arguments{"extract", example.store, folder.File("out.ply")};
    arguments.insert(arguments.end(), options.begin(), options.end());
    RunFails(code, arguments, words);
  };
  for (const auto& [option, texts] : std::vector<std::pair<std::string, Arguments>>{
           {"--half-space", {"", "1,2,3", "0,0,0,0,0,0", "0,0,0,1,0,x"}},
           {"--point", {"", "1,2", "1,2,nan", "1e31,0,0"}},
           {"--segment", {"1,2,3,4,5", "1,2,3,4,5,6,7"}},
           {"--tube", {"1", "1,2,3", "-1,0,0,0", "1,2,3,4,5", "1,2,3,4,5,6,x"}},
           {"--prism", {"0,0,1,1", "0,0,1,1,2", "0,0,1,1,2,x"}},
           {"--wedge", {"0,0,1,0", "0,0,0,0,30", "0,0,1,0,180", "0,0,1,0,0", "0,0,1,0,30,-1"}},
           {"--error-at", {"", "linear", "linear,0,0,0,1", "cubic,0,0,0,1,1", "exp,0,0,0,1,1,1"}},
           {"--pixels", {"0", "-1", "x"}},
           {"--error-outside", {"-1", "x"}},
           {"--fov", {"0", "-1", "x"}},
           {"--viewport", {"0x10", "10"}},
           {"--eye", {"1,2", "x"}},
           {"--target", {"1,2,3,4"}}}) {
    for (const std::string& text : texts) fails(2, {option + "=" + text}, {option, text});
  }
  fails(2, {"--frustum"}, {"--frustum", "--eye and --target"});
  fails(2, {"--pixels", "1", "--eye", "0,0,0"}, {"--pixels", "--eye and --target"});
  fails(2, {"--target", "0,0,0"}, {"--target", "--eye"});
  fails(2, {"--fov", "30"}, {"--fov", "--eye"});
  fails(2, {"--eye", "0,0,0", "--target", "0,1,0"}, {"--eye", "--frustum or --pixels"});
  const Arguments camera{"--frustum", "--eye", "0,0,0", "--target"};
  const auto with = [&](const Arguments& more) {
    Arguments all = camera;
    all.insert(all.end(), more.begin(), more.end());
    return all;
  };
  fails(2, with({"0,0,0"}), {"target", "eye"});
  fails(2, with({"0,0,5"}), {"--up", "along"});
  fails(2, with({"0,1,0", "--fov", "180"}), {"--fov", "180"});
  fails(2, {"--clip"}, {"--clip", "region"});
  fails(2, {"--outside"}, {"--outside", "region"});
  fails(2, {"--intersect"}, {"--intersect", "region"});
  fails(2, {"--error-outside", "1"}, {"--error-outside", "region"});
  fails(2, {"--error-outside", "1", "--clip", "--point", "0,0,0"}, {"--error-outside", "--clip"});
  fails(2, {"--full", "--pixels", "1"}, {"--full", "--pixels"});
  const std::string file = folder.File("q.json");
  fails(2, {"--query", file, "--point", "0,0,0"}, {"--query", "region"});
  fails(2, {"--query", file, "--error", "1"}, {"--query", "threshold"});
  fails(1, {"--query", file}, {file, "no such file"});
  fails(1, {"--query", folder.File("")}, {"cannot be read"});
  WriteText(file, "{\"threshold\": -1}");
  fails(1, {"--query", file}, {file, "threshold:", "-1"});
  WriteText(file, "{\"threshold\": 1");
  fails(1, {"--query", file}, {file, "byte 16"});
  WriteText(file, "{\"threshold\": 1}");
  fails(1, {"--query", file, "--clip"}, {file, "--clip"});
  CHECK_FALSE(Exists(folder.File("out.ply")));
}

}  // namespace mtdb::test
