// The commands of docs/guide.md, one after the other, as a reader runs them.
#include <catch2/catch.hpp>
#include <fstream>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {

TEST_CASE("the commands of the guide run as they stand", "[cli]") {
  const Folder folder;
  std::ifstream guide(std::string(MTDB_SOURCE_DIR) + "/docs/guide.md");
  REQUIRE(guide.is_open());
  // Indented by four: a command. The PATH of the test is the program's own.
  const std::string program(MTDB_BINARY);
  const std::string head = "cd " + folder.File("") +
                           " && export PATH=" + program.substr(0, program.rfind('/')) +
                           ":$PATH && set -e -o pipefail && ";
  int commands = 0;
  for (std::string line; std::getline(guide, line);) {
    if (!line.starts_with("    mtdb ")) continue;
    ++commands;
    INFO(line);
    const std::string script = folder.File("command.sh");
    WriteText(script, head + line.substr(4) + "\n");
    const int status =
        std::system(("timeout 200 bash " + script + " > " + folder.File("said") + " 2>&1").c_str());
    INFO(ReadText(folder.File("said")));
    CHECK(status == 0);
  }
  CHECK(commands >= 10);
}

}  // namespace mtdb::test
