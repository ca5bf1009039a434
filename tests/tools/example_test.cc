// SPDX-License-Identifier: Apache-2.0
// The example programs run.
#include <set>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

std::string WithoutSpace(std::string text) {
  std::erase_if(text, [](char c) { return c == ' ' || c == '\n'; });
  return text;
}

// What lies between `begin` and `end`, each time.
std::vector<std::string> Between(const std::string& text, const std::string& begin,
                                 const std::string& end) {
  std::vector<std::string> found;
  for (size_t at = text.find(begin); at != std::string::npos; at = text.find(begin, at)) {
    at += begin.size();
    found.push_back(text.substr(at, text.find(end, at) - at));
  }
  return found;
}

// What the program prints when it is run on a store.
std::string RunExample(const std::string& program, const std::string& store) {
  const Folder folder;
  const std::string command =
      "'" + program + "' '" + store + "' > '" + folder.File("out") + "' 2>&1";
  const int status = std::system(command.c_str());
  return ReadText(folder.File("out")) + "exit " + std::to_string(WEXITSTATUS(status));
}

TEST_CASE("the examples of C++ and C open a store and take a part of it", "[cli]") {
  const Example& example = TheExample();
  for (const std::string program : {MTDB_EXAMPLE_MINIMAL, MTDB_EXAMPLE_C}) {
    INFO(program);
    const std::string good = RunExample(program, example.store);
    CHECK_THAT(good, Catch::Contains("triangles, error at most"));
    CHECK_THAT(good, Catch::EndsWith("exit 0"));
    const std::string bad = RunExample(program, "/no/such/store");
    CHECK_THAT(bad, Catch::Contains("/no/such/store") && Catch::EndsWith("exit 1"));
  }
  CHECK_THAT(RunExample(MTDB_EXAMPLE_C, example.store), Catch::Contains("closest point"));
}

TEST_CASE("the example of queries has all of docs/query.md, and both ways give one mesh", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("terrain.mtdb");
  RunOk({"generate", "terrain", folder.File("t.ply"), "--triangles", "20000"});
  RunOk({"ingest", folder.File("t.ply"), store, "--quiet"});
  const std::string printed = RunExample(MTDB_EXAMPLE_QUERIES, store);
  INFO(printed);
  CHECK_THAT(printed, Catch::EndsWith("exit 0"));
  // A query, and below it what came of it.
  std::vector<Json> asked;
  std::set<std::string> answers;
  for (size_t at = 0; at < printed.rfind("exit ");) {
    const size_t end = printed.rfind('\n', printed.find(" triangles, error at most", at));
    const size_t next = printed.find('\n', end + 1) + 1;
    REQUIRE(end > at);
    asked.push_back(ParseJson(printed.substr(at, end - at)));
    const std::string answer = printed.substr(end, next - end);
    CHECK_THAT(answer, !Catch::StartsWith("\n  0 triangles"));
    answers.insert(answer);
    at = next;
  }
  CHECK(answers.size() >= asked.size() - 5);  // some ask for all there is
  const std::string page = ReadText(std::string(MTDB_SOURCE_DIR) + "/docs/query.md");
  const std::vector<std::string> blocks = Between(page, "```json\n", "```");
  REQUIRE(blocks.size() > 30);
  for (size_t i = 1; i < blocks.size(); ++i) {  // the first shows all keys at once
    INFO(blocks[i]);
    CHECK(std::count(asked.begin(), asked.end(), ParseJson(blocks[i])) == 1);
  }
  CHECK(asked.size() == blocks.size() - 1);
  // The C++ of the tables, too.
  const std::string program =
      WithoutSpace(ReadText(std::string(MTDB_SOURCE_DIR) + "/tools/example_queries.cc"));
  const std::vector<std::string> rows = Between(page.substr(page.find("## In C++")), "\n| `", "\n");
  CHECK(rows.size() > 30);
  for (const std::string& row : rows) {
    const std::vector<std::string> code = Between(row, "| `", "` |");
    INFO(row);
    REQUIRE(!code.empty());
    CHECK_THAT(program, Catch::Contains(WithoutSpace(code[0])));
  }
}

}  // namespace
}  // namespace mtdb::test
