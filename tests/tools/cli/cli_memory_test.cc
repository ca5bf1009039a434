// SPDX-License-Identifier: Apache-2.0
// The program in an address space that is too small: it works, or says so in one line and leaves
// nothing behind.
#include <catch2/catch.hpp>
#include <set>
#include <string>
#include <sys/resource.h>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

std::set<std::string> FilesIn(const std::string& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    names.insert(entry.path().filename().string());
  }
  return names;
}

// Runs mtdb with at most so many bytes of address space.
Outcome RunWithin(uint64_t bytes, const Arguments& arguments) {
  const Folder folder;
  const std::string out = folder.File("out");
  const std::string err = folder.File("err");
  std::vector<char*> argv{const_cast<char*>(MTDB_BINARY)};
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    const int out_file = ::open(out.c_str(), O_WRONLY | O_CREAT, 0600);
    const int err_file = ::open(err.c_str(), O_WRONLY | O_CREAT, 0600);
    const rlimit limit{bytes, bytes};
    const rlimit no_core{0, 0};
    if (out_file < 0 || err_file < 0 || ::dup2(out_file, 1) < 0 || ::dup2(err_file, 2) < 0 ||
        ::setrlimit(RLIMIT_CORE, &no_core) != 0 || ::setrlimit(RLIMIT_AS, &limit) != 0) {
      ::_exit(126);
    }
    ::alarm(kTimeoutSeconds);
    ::execv(MTDB_BINARY, argv.data());
    ::_exit(127);
  }
  Outcome outcome = Finish(child);
  outcome.out = ReadText(out);
  outcome.err = ReadText(err);
  return outcome;
}

}  // namespace

TEST_CASE("in any address space a verb works or says so in one line and leaves nothing") {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  WARN("skipped: sanitizers need their address space");
  return;
#endif
  const std::string store = TheExample().store;
  const Folder folder;
  const std::string work = folder.File("work");
  std::filesystem::create_directory(work);
  const std::vector<Arguments> verbs{
      {"extract", store, work + "/out.ply"},
      {"extract", store, work + "/out.glb", "--error", "1%", "--normals"},
      {"extract", store, work + "/out.drc"},
      {"extract", store, work + "/out.stl", "--triangles", "500"},
      {"verify", store, "--level", "full"},
      {"render", store, work + "/out.png"},
      {"probe", store, "--point", "0,0,0"},
  };
  int failed = 0;  // of all: one that only reads works wherever it can be loaded
  for (const Arguments& verb : verbs) {
    bool worked = false;
    // From less than it takes to start the program to twice of what the verb needs.
    uint64_t enough = 0;
    for (uint64_t bytes = uint64_t{20} << 20; enough == 0 || bytes < 2 * enough;
         bytes += bytes / 12) {
      REQUIRE(bytes < uint64_t{1} << 36);
      const Outcome outcome = RunWithin(bytes, verb);
      INFO(Join(verb) << "\nin " << bytes << " bytes: exit " << outcome.exit_code << ", signal "
                      << outcome.signal << "\n"
                      << outcome.err);
      const std::set<std::string> left = FilesIn(work);
      // The system could not load it, or a library could not begin.
      if (outcome.exit_code == 127 || RunWithin(bytes, {"--version"}).exit_code != 0) {
        REQUIRE(left.empty());
        continue;
      }
      if (outcome.exit_code == 0) {
        worked = true;
        if (enough == 0) enough = bytes;
        const bool writes = verb[0] == "extract" || verb[0] == "render";
        REQUIRE(left.size() == (writes ? 1 : 0));
        if (writes) std::filesystem::remove(work + "/" + *left.begin());
        continue;
      }
      ++failed;
      REQUIRE(outcome.exit_code == 1);
      REQUIRE(IsOneLine(outcome.err));
      REQUIRE(left.empty());
    }
    CHECK(worked);
  }
  CHECK(failed > 0);
}

}  // namespace mtdb::test
