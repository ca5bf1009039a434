// SPDX-License-Identifier: Apache-2.0
// Ingests that were killed: what is left, what `list` says of it, and how they go on.
#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <thread>

#include "store/database.h"
#include "tests/tools/cli_testing.h"
#include "tests/tools/json_tables.h"
#include "tools/cli/verbs/ingest_journal.h"

namespace mtdb::test {
namespace {

std::vector<std::string> FilesOf(const Folder& folder, const std::string& ending) {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder.File(""))) {
    if (entry.path().string().ends_with(ending)) files.push_back(entry.path().string());
  }
  return files;
}

// Kills an ingest into `store` as soon as its journal in `folder` holds something; returns the
// journal.
std::string IngestAndKill(const Arguments& arguments, const std::string& store,
                          const Folder& folder) {
  for (int attempt = 0; attempt < 20; ++attempt) {
    const Folder prints;
    const pid_t process = Start(arguments, prints.File("out"), prints.File("err"));
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    std::vector<std::string> journals;
    while (std::chrono::steady_clock::now() < until) {
      journals = FilesOf(folder, ".journal");
      std::error_code error;
      if (journals.size() == 1 && std::filesystem::file_size(journals[0], error) > 50000) break;
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    ::kill(process, SIGKILL);
    const Outcome outcome = Finish(process);
    INFO(ReadText(prints.File("err")));
    if (outcome.signal == SIGKILL && Exists(journals.at(0))) return journals[0];
    REQUIRE(outcome.exit_code == 0);  // it was faster than this process
    std::filesystem::remove(store);
    std::filesystem::remove(store + "-lock");
  }
  FAIL("no ingest could be killed in time");
  return "";
}

TEST_CASE("an ingest that begins anew says that --resume would go on", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("a.ply"), store = folder.File("store.mtdb");
  RunOk({"generate", "sculpture", mesh, "--triangles", "150000"});
  const Arguments ingest{"ingest", mesh, "--name", "a", "--threads", "2", store};
  IngestAndKill(ingest, store, folder);
  const Outcome again = Run(ingest);
  CHECK(again.exit_code == 0);
  CHECK_THAT(again.err, Catch::Contains("an ingest of a was interrupted after ") &&
                            Catch::Contains("with --resume it would go on"));
  CHECK_FALSE(RunJson({"list", store}).contains("journals"));
}

TEST_CASE("list tells of an interrupted ingest, and its command goes on with it", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("a mesh's.ply");
  const std::string store = folder.File("store.mtdb");
  RunOk({"generate", "sculpture", mesh, "--triangles", "150000"});
  const Json fresh = RunJson({"ingest", mesh, folder.File("other.mtdb"), "--name", "o'1"});
  const std::string journal = IngestAndKill(
      {"ingest", mesh, "--name", "o'1", "--threads", "2", store, "--bits", "16"}, store, folder);
  CHECK(FilesOf(folder, ".tmp").empty());
  const Json list = RunJson({"list", store});
  JsonTables().Check(list);
  REQUIRE(list.at("journals").size() == 1);
  const Json& left = list["journals"][0];
  CHECK(left.at("object") == "o'1");
  CHECK(left.at("running") == false);
  CHECK(left.at("journal") == journal);
  CHECK(left.at("bytes") == std::filesystem::file_size(journal));
  const std::string text = RunOk({"list", store});
  CHECK_THAT(text, Catch::Contains("o'1") && Catch::Contains(journal) &&
                       Catch::Contains("--resume") && Catch::Contains("rm "));
  // Other stores and folders have none.
  CHECK_FALSE(RunJson({"list", folder.File("other.mtdb")}).contains("journals"));
  // The command that list prints works as it is, in a shell.
  const std::string resume = left.at("resume");
  REQUIRE(resume.starts_with("mtdb ingest "));
  const std::string command = "cd '" + left.at("folder").get<std::string>() + "' && '" +
                              MTDB_BINARY + "'" + resume.substr(4) + " --quiet";
  INFO(command);
  REQUIRE(std::system(command.c_str()) == 0);
  CHECK_FALSE(Exists(journal));
  CHECK_FALSE(RunJson({"list", store}).contains("journals"));
  CHECK(RunJson({"info", store}).at("objects").at(0).at("digest") == fresh.at("digest"));
}

TEST_CASE("a store has one path by every name, before and after it is made") {
  const Folder folder;
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::create_directory(folder.File("sub"));
  std::filesystem::create_symlink("store.mtdb", folder.File("link.mtdb"));
  std::filesystem::current_path(folder.File(""));
  const std::string real =
      std::filesystem::canonical(folder.File("sub")).parent_path().string() + "/store.mtdb";
  for (const bool made : {false, true}) {
    if (made) WriteText(folder.File("store.mtdb"), "x");
    for (const char* name : {"store.mtdb", "./store.mtdb", "link.mtdb", "sub/../store.mtdb"}) {
      CHECK(RealStorePath(name) == real);
    }
    CHECK(RealStorePath(folder.File("store.mtdb")) == real);
    CHECK(RealStorePath(folder.File("link.mtdb")) == real);
  }
  std::filesystem::current_path(before);
}

TEST_CASE("a journal serves its own ingest only: other files, other order, other options",
          "[cli]") {
  const Folder folder;
  const std::string a = folder.File("a.ply");
  const std::string b = folder.File("b.ply");
  const std::string store = folder.File("store.mtdb");
  RunOk({"generate", "sculpture", a, "--triangles", "80000"});
  RunOk({"generate", "terrain", b, "--triangles", "60000"});
  const Json fresh = RunJson({"ingest", a, b, folder.File("other.mtdb"), "--name", "both"});
  const std::string journal = IngestAndKill(
      {"ingest", a, b, "--name", "both", "--quiet", store, "--threads", "2"}, store, folder);
  RunFails(1, {"ingest", b, a, store, "--name", "both", "--resume", "--quiet"},
           {journal, "another input"});
  RunFails(1, {"ingest", a, store, "--name", "both", "--resume", "--quiet"},
           {journal, "another input"});
  RunFails(1, {"ingest", a, b, store, "--name", "both", "--resume", "--bits", "12", "--quiet"},
           {journal, "other options"});
  RunFails(1, {"ingest", a, b, store, "--name", "both", "--resume", "--orient", "--quiet"},
           {journal, "other options"});
  // By another name of the same store it is the same journal.
  const std::string link = folder.File("link.mtdb");
  std::filesystem::create_symlink(store, link);
  CHECK(RunJson({"list", link}).at("journals").size() == 1);
  CHECK(RunJson({"ingest", a, b, link, "--name", "both", "--resume"}).at("digest") ==
        fresh.at("digest"));
  CHECK_FALSE(Exists(journal));
  CHECK(RunJson({"verify", store, "--level", "full"}).at("ok") == true);
}

// What may come after an ingest was killed.
enum class Next { kList, kResume, kIngest, kOtherInput, kRemove };

// An ingest of object "o" that is killed at its n-th operation on files, into a store that has the
// same mesh by another name and, to be replaced, another mesh by this one.
class KilledIngest {
 public:
  KilledIngest(int64_t operation, bool replace) : replace_(replace) {
    RunOk({"generate", "sculpture", mesh_, "--triangles", "3000"});
    RunOk({"generate", "sculpture", other_, "--triangles", "2000", "--seed", "2"});
    RunOk({"ingest", mesh_, store_, "--name", "twin", "--quiet"});
    if (replace) RunOk({"ingest", other_, store_, "--name", "o", "--quiet"});
    fresh_ = Digest("twin");
    const std::vector<std::pair<std::string, std::string>> settings{
        {"LD_PRELOAD", MTDB_FAULTS_LIBRARY},
        {"MTDB_FAULT", "kill"},
        {"MTDB_FAULT_UNDER", folder_.File("")},
        {"MTDB_FAULT_AT", std::to_string(operation)},
        {"MTDB_FAULT_COUNT", folder_.File("count")}};
    for (const auto& [name, value] : settings) ::setenv(name.c_str(), value.c_str(), 1);
    const Outcome outcome = Run(Command({"--threads", "1"}));
    for (const auto& [name, value] : settings) ::unsetenv(name.c_str());
    CHECK((operation == 0 ? outcome.exit_code == 0 : outcome.signal == SIGKILL));
  }
  // After an ingest that was not killed.
  int64_t Operations() const { return std::stoll(ReadText(folder_.File("count"))); }

  // Empty: there is no such object.
  std::string Digest(const std::string& name) const {
    const Json info = RunJson({"info", store_});
    for (const Json& o : info.at("objects")) {
      if (o.at("object") == name) return o.at("digest");
    }
    return "";
  }
  std::vector<std::string> Journals() const { return FilesOf(folder_, ".journal"); }
  Arguments Command(const Arguments& more, bool other_input = false) const {
    Arguments command{"ingest", other_input ? other_ : mesh_, store_, "--name", "o", "--quiet"};
    if (replace_) command.emplace_back("--replace");
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }

  void GoOn(Next next) const {
    const bool published = Digest("o") == fresh_;
    const bool left = !Journals().empty();
    const bool there = published && !replace_;  // and must not be replaced
    switch (next) {
      case Next::kList:
        CHECK(RunJson({"list", store_}).contains("journals") == (left && !published));
        CHECK(Journals().empty() == (published || !left));
        if (!published) RunOk(Command({"--resume"}));
        break;
      case Next::kResume:
        if (there && !left) {
          RunFails(1, Command({"--resume"}), {"object o is there"});
        } else {
          RunOk(Command({"--resume"}));
        }
        break;
      case Next::kIngest:
        if (there) {
          RunFails(1, Command({}), {"object o is there"});
        } else {
          RunOk(Command({}));
        }
        break;
      case Next::kOtherInput:
        if (left) RunFails(1, Command({"--resume"}, true), {"another input"});
        CHECK((Digest("o") == fresh_) == published);
        if (left || !there) RunOk(Command({"--resume"}));
        break;
      case Next::kRemove:
        if (published) {
          RunOk({"remove", store_, "o"});
          CHECK_FALSE(RunJson({"list", store_}).contains("journals"));
        }
        RunOk(Command(published ? Arguments{} : Arguments{"--resume"}));
        break;
    }
    CHECK(Journals().empty());
    CHECK(Digest("o") == fresh_);
    CHECK(Digest("twin") == fresh_);
    CHECK(RunJson({"verify", store_, "--level", "full"}).at("ok") == true);
  }

 private:
  Folder folder_;
  bool replace_;
  std::string mesh_ = folder_.File("mesh.ply");
  std::string other_ = folder_.File("other.ply");
  std::string store_ = folder_.File("store.mtdb");
  std::string fresh_;
};

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they must be loaded first

TEST_CASE("a journal whose object is published is finished work, whoever finds it", "[cli]") {
  for (const bool replace : {false, true}) {
    const int64_t operations = KilledIngest(0, replace).Operations();
    REQUIRE(operations > 20);
    for (int64_t n = operations - 15; n <= operations; ++n) {
      const auto next = static_cast<Next>(n % 5);
      const auto other = static_cast<Next>((n + 2) % 5);
      INFO("killed at operation " << n << " of " << operations << (replace ? ", replacing" : "")
                                  << ", then " << n % 5 << " and " << (n + 2) % 5);
      KilledIngest(n, replace).GoOn(next);
      KilledIngest(n, replace).GoOn(other);
    }
  }
}

#endif

TEST_CASE("an ingest that the store refuses in the end keeps its work, and says so", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("mesh.ply");
  const std::string store = folder.File("store.mtdb");
  const std::string link = folder.File("link.mtdb");
  RunOk({"generate", "sculpture", mesh, "--triangles", "3000"});
  RunOk({"ingest", mesh, store, "--name", "a", "--quiet"});
  std::filesystem::create_hard_link(store, link);
  {
    const auto writer = Database::Open(store, {.writable = true});
    REQUIRE(writer.ok());
    RunFails(1, {"ingest", mesh, link, "--name", "b", "--quiet"},
             {"by another name", "--resume goes on"});
    CHECK(RunJson({"list", link}).at("journals").size() == 1);
  }
  RunOk({"ingest", mesh, link, "--name", "b", "--quiet", "--resume"});
  CHECK(FilesOf(folder, ".journal").empty());
}

}  // namespace
}  // namespace mtdb::test
