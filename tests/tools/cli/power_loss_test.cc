// SPDX-License-Identifier: Apache-2.0
// A power failure at any moment: what was published stays, and a file that has its name is whole:
// a mesh, a packed file, a copy, a store that was compacted.
#include "tests/support/power_loss.h"

#include <catch2/catch.hpp>
#include <cstdlib>
#include <map>
#include <set>

#include "store/database.h"
#include "store/verify_store.h"
#include "tests/tools/cli_testing.h"

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they must be loaded first

namespace mtdb::test {
namespace {

using testing::DiskModel;
using testing::ReadWriteLog;
using testing::WriteEvent;

// Runs the program with its writes noted.
void RunNoted(const Arguments& arguments, const std::string& log, const std::string& folder) {
  ::setenv("MTDB_WRITE_LOG", log.c_str(), 1);
  ::setenv("MTDB_WRITE_LOG_FOLDER", folder.c_str(), 1);
  ::setenv("LD_PRELOAD", MTDB_WRITE_LOG_LIBRARY, 1);
  const Outcome outcome = Run(arguments);
  ::unsetenv("LD_PRELOAD");
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);
}

// Names of the objects of a store that must be sound.
std::set<std::string> SoundObjects(const std::string& store) {
  CheckReport report;
  REQUIRE(VerifyStore(store, "", &report).message() == "");
  for (const std::string& failure : report.failures) CHECK(failure == "");
  const auto database = Database::Open(store);
  REQUIRE(database.status().message() == "");
  const auto list = (*database)->List();
  REQUIRE(list.status().message() == "");
  std::set<std::string> names;
  for (const ObjectRecord& record : *list) names.insert(record.name);
  return names;
}

TEST_CASE("after a power failure at any moment what was published is there", "[cli]") {
  const Folder folder;
  const std::string data = std::filesystem::canonical(folder.File("")).string() + "/data";
  std::filesystem::create_directory(data);
  const std::string log = folder.File("log");
  const std::string store = data + "/store.mtdb";
  const std::string output = data + "/out.ply";
  const std::string packed = data + "/packed.mtdbp";
  const std::string copy = data + "/copy.mtdb";
  std::vector<std::string> meshes;
  for (const char* seed : {"1", "2"}) {
    meshes.push_back(folder.File("mesh" + std::string(seed) + ".ply"));
    RunOk({"generate", "sculpture", meshes.back(), "--triangles", "6000", "--seed", seed});
  }
  // What is certain once each command has ended.
  const std::vector<std::pair<Arguments, std::set<std::string>>> commands{
      {{"ingest", meshes[0], store, "--name", "a", "--quiet"}, {"a"}},
      {{"ingest", meshes[1], store, "--name", "b", "--quiet"}, {"a", "b"}},
      {{"ingest", meshes[0], store, "--name", "b", "--replace", "--quiet"}, {"a", "b"}},
      {{"remove", store, "a"}, {"b"}},
      {{"extract", store, output}, {"b"}},
      {{"ingest", meshes[1], store, "--name", "c", "--quiet"}, {"b", "c"}},
      {{"pack", store, packed}, {"b", "c"}},
      {{"rename", store, "c", "d"}, {"b", "d"}},
      {{"compact", store}, {"b", "d"}},
      {{"copy", store, copy}, {"b", "d"}},
      {{"ingest", meshes[0], store, "--name", "e", "--quiet"}, {"b", "d", "e"}},
      {{"unpack", packed, store, "--name", "c"}, {"b", "c", "d", "e"}},
  };
  std::vector<size_t> ends;
  for (const auto& [arguments, names] : commands) {
    RunNoted(arguments, log, data);
    ends.push_back(ReadWriteLog(log).size());
  }
  const std::map<std::string, std::string> wholes{{"/out.ply", ReadText(output)},
                                                  {"/packed.mtdbp", ReadText(packed)}};
  const std::vector<WriteEvent> events = ReadWriteLog(log);
  REQUIRE(events.size() > 50);
  DiskModel disk;
  std::mt19937_64 random(9);
  size_t command = 0;
  std::map<std::string, int> seen;  // how often each file had its name
  const std::string after = folder.File("after");
  for (size_t i = 0; i < events.size(); ++i) {
    disk.Apply(events[i]);
    while (command < ends.size() && i + 1 >= ends[command]) ++command;
    if (command == 0) continue;  // nothing was promised yet
    const std::set<std::string>& before = commands[command - 1].second;
    const std::set<std::string>& next = commands[std::min(command, commands.size() - 1)].second;
    for (int variant = 0; variant < 3; ++variant) {
      INFO("event " << i << " of " << events.size() << ", variant " << variant);
      disk.Make(data, after, variant == 0 ? nullptr : &random);
      const std::set<std::string> found = SoundObjects(after + "/store.mtdb");
      CHECK((found == before || found == next));
      for (const auto& [name, whole] : wholes) {
        if (!Exists(after + name)) continue;
        ++seen[name];
        CHECK(ReadText(after + name) == whole);
      }
      if (!Exists(after + "/copy.mtdb")) continue;
      ++seen["copy"];
      CHECK(SoundObjects(after + "/copy.mtdb") == std::set<std::string>{"b", "d"});
    }
  }
  CHECK(seen["/out.ply"] > 0);
  CHECK(seen["/packed.mtdbp"] > 0);
  CHECK(seen["copy"] > 0);
}

}  // namespace
}  // namespace mtdb::test

#endif
