// SPDX-License-Identifier: Apache-2.0
// Several processes on one store: killed, and side by side.
#include <array>
#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <map>
#include <random>
#include <sys/stat.h>
#include <thread>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

using Clock = std::chrono::steady_clock;

// Changes whenever somebody writes to the file.
std::array<int64_t, 3> FileState(const std::string& path) {
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) return {};
  return {info.st_size, info.st_mtim.tv_sec, info.st_mtim.tv_nsec};
}

std::map<std::string, uint64_t> ListedTriangles(const std::string& store) {
  std::map<std::string, uint64_t> triangles;
  const Json list = RunJson({"list", store});
  for (const Json& o : list.at("objects")) triangles[o.at("object")] = o.at("triangles");
  return triangles;
}

TEST_CASE("a killed ingest leaves whole objects only, and the store takes it again", "[cli]") {
  const Example& kept = SmallExample();
  const Folder folder;
  const std::string mesh = folder.File("fresh.ply");
  const std::string store = folder.File("store.mtdb");
  const std::string output = folder.File("out.ply");
  RunOk({"generate", "sculpture", mesh, "--triangles", "100000", "--seed", "3"});
  RunOk({"ingest", kept.mesh, store, "--name", "kept", "--quiet"});
  const Arguments ingest{"ingest", mesh, store, "--quiet"};

  // Undisturbed, elsewhere: how long it takes and what comes of it.
  const Clock::time_point begin = Clock::now();
  const Json fresh = RunJson({"ingest", mesh, folder.File("other.mtdb")});
  double seconds = std::chrono::duration<double>(Clock::now() - begin).count();

  std::mt19937_64 random(11);
  const auto uniform = [&] { return static_cast<double>(random() % 1000000) / 1e6; };
  int killed = 0;
  for (int i = 0; killed < 12 && i < 100; ++i) {
    const auto state = FileState(store);
    const pid_t process = Start(ingest, folder.File("out"), folder.File("err"));
    if (i % 2 == 0) {
      std::this_thread::sleep_for(std::chrono::duration<double>(seconds * 1.1 * uniform()));
    } else {
      // Shortly after its first write.
      const Clock::time_point until = Clock::now() + std::chrono::seconds(60);
      while (FileState(store) == state && Clock::now() < until) {
        std::this_thread::sleep_for(std::chrono::microseconds(200));
      }
      std::this_thread::sleep_for(std::chrono::duration<double>(seconds * 0.5 * uniform()));
    }
    ::kill(process, SIGKILL);
    const Outcome outcome = Finish(process);
    if (outcome.signal == SIGKILL) {
      ++killed;
    } else {
      seconds *= 0.8;  // the machine has become faster
    }
    INFO("kill " << i << ": " << ReadText(folder.File("err")));
    CHECK((outcome.signal == SIGKILL || outcome.exit_code == 0));

    const auto listed = ListedTriangles(store);
    REQUIRE(listed.contains("kept"));
    CHECK(listed.at("kept") == kept.info.at("triangles"));
    CHECK(listed.size() == (listed.contains("fresh") ? 2 : 1));
    const Json verify = RunJson({"verify", store, "--level", "full"});
    CHECK(verify.at("ok") == true);
    if (listed.contains("fresh")) {
      CHECK(listed.at("fresh") == fresh.at("triangles"));
    } else if (i % 5 == 4) {
      CHECK(RunJson({"ingest", mesh, store}).at("digest") == fresh.at("digest"));
    }
    if (ListedTriangles(store).size() == 2) RunOk({"remove", store, "fresh"});
  }
  CHECK(killed == 12);
  CHECK(RunJson({"ingest", mesh, store}).at("digest") == fresh.at("digest"));
  CHECK(RunJson({"verify", store, "--level", "global"}).at("ok") == true);
  RunOk({"extract", store, output, "--name", "kept"});
  CHECK(ReadText(output) == ReadText(kept.full));
  // Nothing is lost to the dead: the file is hardly larger than what it holds.
  const Json info = RunJson({"info", store});
  CHECK(info.at("file_bytes") < 4 * fresh.at("file_bytes").get<uint64_t>());
}

TEST_CASE("extract goes on while another process ingests into the same store", "[cli]") {
  const Example& kept = SmallExample();
  const Folder folder;
  const std::string mesh = folder.File("fresh.ply");
  const std::string store = folder.File("store.mtdb");
  const std::string output = folder.File("out.ply");
  RunOk({"generate", "sculpture", mesh, "--triangles", "60000", "--seed", "3"});
  RunOk({"ingest", kept.mesh, store, "--name", "kept", "--quiet"});
  const std::string expected = ReadText(kept.full);
  const pid_t process =
      Start({"ingest", mesh, store, "--quiet"}, folder.File("o"), folder.File("e"));
  int status = 0;
  int extracts = 0;
  while (::waitpid(process, &status, WNOHANG) == 0) {
    RunOk({"extract", store, output, "--name", "kept"});
    CHECK(ReadText(output) == expected);
    ++extracts;
  }
  INFO(ReadText(folder.File("e")));
  CHECK(status == 0);
  CHECK(extracts >= 3);
  CHECK(ListedTriangles(store).size() == 2);
  CHECK(RunJson({"verify", store, "--level", "full"}).at("ok") == true);
}

TEST_CASE("two processes may ingest different objects, but not the same one", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("mesh.ply");
  const std::string store = folder.File("store.mtdb");
  RunOk({"generate", "sculpture", mesh, "--triangles", "30000", "--seed", "5"});
  const auto start = [&](const std::string& name, const std::string& err) {
    return Start({"ingest", mesh, store, "--name", name, "--quiet"}, folder.File("o"),
                 folder.File(err));
  };
  const pid_t a = start("a", "e1");
  const pid_t b = start("b", "e2");
  const pid_t same = start("a", "e3");
  const Outcome first = Finish(a);
  const Outcome other = Finish(b);
  const Outcome second = Finish(same);
  INFO(ReadText(folder.File("e1")) << ReadText(folder.File("e2")) << ReadText(folder.File("e3")));
  CHECK(other.exit_code == 0);
  CHECK(first.exit_code + second.exit_code == 1);
  CHECK(IsOneLine(ReadText(folder.File(first.exit_code == 1 ? "e1" : "e3"))));
  CHECK(ListedTriangles(store).size() == 2);
  const Json objects = RunJson({"info", store}).at("objects");
  CHECK(objects.at(0).at("digest") == objects.at(1).at("digest"));
  CHECK(RunJson({"verify", store, "--level", "global"}).at("ok") == true);
}

}  // namespace
}  // namespace mtdb::test
