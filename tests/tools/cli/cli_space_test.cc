// SPDX-License-Identifier: Apache-2.0
// Objects that are removed, renamed and copied, and stores that are compacted, by the command line.
#include <catch2/catch.hpp>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <sys/stat.h>

#include "tests/tools/cli_testing.h"
#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

// A store with "a", "b" and "c", of which "b" is the largest.
struct Store {
  Folder folder;
  std::string path = folder.File("s.mtdb");
  Store() {
    for (const auto& [name, triangles] :
         {std::pair("a", "1000"), std::pair("b", "20k"), std::pair("c", "1.5k")}) {
      const std::string mesh = folder.File(std::string(name) + ".ply");
      RunOk({"generate", "sculpture", mesh, "--triangles", triangles});
      RunOk({"ingest", mesh, path, "--quiet"});
    }
  }
};

std::vector<std::string> Names(const std::string& store) {
  std::vector<std::string> names;
  const Json list = RunJson({"list", store});
  for (const Json& o : list.at("objects")) names.push_back(o.at("object"));
  return names;
}

using List = std::vector<std::string>;

}  // namespace

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they must be loaded first

namespace {

std::set<std::string> FilesIn(const Folder& folder) {
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder.File(""))) {
    files.insert(entry.path().filename().string());
  }
  return files;
}

}  // namespace

TEST_CASE("a disk that is full at any moment leaves stores as they were, and no files", "[cli]") {
  const Folder folder, inputs;
  const std::string store = folder.File("s.mtdb"), mesh = inputs.File("a.ply");
  RunOk({"generate", "sculpture", mesh, "--triangles", "800"});
  RunOk({"ingest", mesh, store, "--quiet"});
  const std::string packed = inputs.File("a.mtdbp");
  RunOk({"pack", store, packed});
  const std::set<std::string> before = FilesIn(folder);
  const std::string digest = RunJson({"info", store}).at("objects").at(0).at("digest");
  const std::vector<Arguments> commands{{"compact", store, "--json"},
                                        {"copy", store, folder.File("new.mtdb"), "--json"},
                                        {"pack", store, folder.File("new.mtdbp"), "--json"},
                                        {"unpack", packed, folder.File("new.mtdb"), "--json"},
                                        {"ingest", mesh, folder.File("new.mtdb"), "--quiet"}};
  for (const Arguments& command : commands) {
    int failed = 0;
    // The first one, which nothing disturbs, tells how many there are.
    for (int64_t at = 0, operations = 0; at <= operations; ++at) {
      INFO(command[0] << ", operation " << at);
      const std::vector<std::pair<std::string, std::string>> settings{
          {"LD_PRELOAD", MTDB_FAULTS_LIBRARY},
          {"MTDB_FAULT", "enospc"},
          {"MTDB_FAULT_UNDER", folder.File("")},
          {"MTDB_FAULT_AT", std::to_string(at)},
          {"MTDB_FAULT_COUNT", inputs.File("count")}};
      for (const auto& [name, value] : settings) ::setenv(name.c_str(), value.c_str(), 1);
      const Outcome outcome = Run(command);
      for (const auto& [name, value] : settings) ::unsetenv(name.c_str());
      if (at == 0) operations = std::stoll(ReadText(inputs.File("count")));
      if (outcome.exit_code == 0) {
        for (const char* made : {"new.mtdb", "new.mtdb-lock", "new.mtdbp"}) {
          std::filesystem::remove(folder.File(made));
        }
      } else {
        ++failed;
        REQUIRE(outcome.exit_code == 1);
        CHECK_THAT(outcome.err, Catch::StartsWith("mtdb: "));
      }
      // What an ingest can go on with stays.
      if (outcome.err.find("with --resume goes on") != std::string::npos) {
        for (const std::string& file : FilesIn(folder)) {
          if (file.starts_with("new.")) std::filesystem::remove(folder.File(file));
        }
      }
      CHECK(FilesIn(folder) == before);
    }
    CHECK(RunJson({"info", store}).at("objects").at(0).at("digest") == digest);
    CHECK(failed > 10);
  }
}

#endif

TEST_CASE("removing says what became free, and compacting gives it back", "[cli]") {
  const Store s;
  const Json before = RunJson({"list", s.path});
  const std::string said = RunOk({"remove", s.path, "b", "c", "b"});
  CHECK_THAT(said, Catch::StartsWith("removed b\nremoved c\n"));
  CHECK_THAT(said, Catch::Contains(" were freed; of the file's ") && Catch::Contains("compact"));
  const Json after = RunJson({"list", s.path});
  CHECK(Names(s.path) == List{"a"});
  CHECK(after.at("file_bytes") >= before.at("file_bytes"));
  CHECK(after.at("free_bytes").get<uint64_t>() > 50000);
  CHECK(after.at("free_bytes") > before.at("free_bytes"));
  CHECK_THAT(RunOk({"list", s.path}), Catch::Contains(" are free"));
  const Json compacted = RunJson({"compact", s.path});
  CHECK(compacted.at("file_bytes") == std::filesystem::file_size(s.path));
  CHECK(compacted.at("bytes_before") == after.at("file_bytes"));
  CHECK(compacted.at("freed_bytes").get<uint64_t>() > 50000);
  RunOk({"verify", s.path, "--level", "global"});
  CHECK_THAT(RunOk({"compact", s.path}), Catch::Contains("cannot be made smaller"));
  CHECK(Names(s.path) == List{"a"});
  RunFails(1, {"remove", s.path, "a", "x"}, {"no object x; it holds a\n"});
  CHECK(Names(s.path) == List{"a"});  // none of them
  const Json removed = RunJson({"remove", s.path, "a"});
  CHECK(removed.at("removed") == Json({"a"}));
  RunFails(1, {"compact", s.folder.File("a.ply")}, {"a.ply"});
  RunFails(1, {"compact", s.folder.File("none.mtdb")}, {"none.mtdb: no such file"});
  CHECK_FALSE(Exists(s.folder.File("a.ply.partial")));
}

TEST_CASE("an object is renamed, and not onto another", "[cli]") {
  const Store s;
  CHECK_THAT(RunOk({"rename", s.path, "b", "statue"}), Catch::Contains("b is now statue"));
  CHECK(Names(s.path) == List{"a", "c", "statue"});
  RunFails(1, {"rename", s.path, "a", "c"}, {"c is there"});
  RunFails(1, {"rename", s.path, "b", "d"}, {"no object b; it holds a, c, statue\n"});
  RunFails(2, {"rename", s.path, "a"}, {});
  RunFails(2, {"rename", s.path, "a", ""}, {});
  RunOk({"verify", s.path});
}

TEST_CASE("a copy has all objects or those that are named, and a second one what is new", "[cli]") {
  const Store s;
  const std::string backup = s.folder.File("backup.mtdb");
  CHECK_THAT(RunOk({"copy", s.path, backup}), Catch::Contains("copied a\ncopied b\ncopied c\n"));
  CHECK(Names(backup) == List{"a", "b", "c"});
  RunOk({"verify", backup, "--level", "full"});
  for (const char* const name : {"a", "b", "c"}) {
    const auto digest = [&](const std::string& store) {
      return RunJson({"info", store, "--name", name}).at("objects").at(0).at("digest");
    };
    CHECK(digest(backup) == digest(s.path));
  }
  const std::string part = s.folder.File("part.mtdb");
  RunOk({"copy", s.path, part, "c", "a"});
  CHECK(Names(part) == List{"a", "c"});
  // Again: what is there stays, what differs is refused and then replaced.
  RunOk({"ingest", s.folder.File("c.ply"), s.path, "--name", "a", "--replace", "--quiet"});
  RunOk({"rename", s.path, "b", "d"});
  const std::string before = ReadText(backup);
  RunFails(1, {"copy", s.path, backup}, {"another object a", "--replace", "nothing was copied"});
  CHECK(ReadText(backup) == before);
  const Json again = RunJson({"copy", s.path, backup, "--replace"});
  CHECK(again.at("copied") == Json({"d"}));
  CHECK(again.at("replaced") == Json({"a"}));
  CHECK(again.at("unchanged") == Json({"c"}));
  CHECK(Names(backup) == List{"a", "b", "c", "d"});
  RunOk({"verify", backup, "--level", "full"});
  RunFails(1, {"copy", s.path, s.path}, {"the same store"});
  RunFails(1, {"copy", s.path, part, "x"}, {"no object x; it holds a, "});
  RunFails(1, {"copy", s.path, s.folder.File("a.ply")}, {"a.ply"});
}

TEST_CASE("a server goes on with a store that is compacted", "[cli][server]") {
  const Store s;
  const ServerProcess server(s.path);
  CHECK(server.Get("/objects/a/mesh").status == 200);
  RunOk({"remove", s.path, "b"});
  RunOk({"compact", s.path});
  RunOk({"ingest", s.folder.File("b.ply"), s.path, "--name", "new", "--quiet"});
  CHECK_THAT(server.Get("/objects").body, Catch::Contains("\"new\""));
  CHECK(server.Get("/objects/a/mesh").status == 200);
  CHECK(server.Get("/objects/new/mesh").status == 200);
}

TEST_CASE("words and numbers as people write them", "[cli]") {
  const Example& e = SmallExample();
  const Folder folder;
  const std::string out = folder.File("a.ply");
  RunFails(2, {"extrat", e.store, out}, {"no verb 'extrat'", "did you mean 'extract'"});
  RunFails(2, {"lsit", e.store}, {"did you mean 'list'"});
  RunFails(2, {"frobnicate", e.store}, {"no verb 'frobnicate'"});
  RunFails(2, {"extract", e.store, out, "--eror", "1"}, {"--eror", "did you mean '--error'"});
  RunFails(2, {"extract", e.store, out, "--spher=0,0,0,1"}, {"did you mean '--sphere'"});
  RunFails(2, {"--versoin"}, {"did you mean '--version'"});
  for (const char* const size : {"512MB", "512M", "0.5G", "512MiB", "524288K", "536870912"}) {
    const Json query =
        ParseJson(RunOk({"extract", e.store, out, "--max-bytes", size, "--print-query"}));
    INFO(size);
    CHECK(query.at("max_bytes") == 512u << 20);
  }
  for (const char* const count : {"1500", "1.5k", "1.5K", "0.0015M"}) {
    const Json query =
        ParseJson(RunOk({"extract", e.store, out, "--triangles", count, "--print-query"}));
    INFO(count);
    CHECK(query.at("max_triangles") == 1500);
  }
  const auto box = [&](const std::string& text) {
    return RunOk({"extract", e.store, out, "--box=" + text, "--print-query"});
  };
  CHECK(box("1,2,-3,-4,5,6") == box("-4,2,-3,1,5,6"));
}

TEST_CASE("the cache of a query can be given, and answers do not depend on it", "[cli]") {
  const Example& e = TheExample();
  const Folder folder;
  RunOk({"extract", e.store, folder.File("a.ply"), "--error", "0.1%"});
  RunOk({"extract", e.store, folder.File("b.ply"), "--error", "0.1%", "--cache", "16MB"});
  CHECK(ReadText(folder.File("a.ply")) == ReadText(folder.File("b.ply")));
  RunOk({"render", e.store, folder.File("a.png"), "--size", "40x30", "--cache", "64M"});
  RunFails(2, {"extract", e.store, folder.File("a.ply"), "--cache", "0"}, {"--cache", "0"});
}

}  // namespace mtdb::test
