// SPDX-License-Identifier: Apache-2.0
// The options that say what is asked for: the queries in JSON that they stand for.
#include <catch2/catch.hpp>
#include <set>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {

TEST_CASE("Options stand for the queries that the page says", "[query][cli]") {
  const auto printed = [](Arguments options) {
    options.insert(options.begin(), {"extract", "no.mtdb", "out.ply"});
    options.push_back("--print-query");
    return ParseJson(RunOk(options));
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
    Json expected = ParseJson(page.substr(block + 8, page.find("```", block + 8) - block - 8));
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
      {"--sphere", "0,0,0,0.5", "--error", "0.1%"},
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
  fails(2, with({"0,0,5", "--up", "0,0,1"}), {"--up", "along"});
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
