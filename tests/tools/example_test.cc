// The example programs run.
#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

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

}  // namespace
}  // namespace mtdb::test
