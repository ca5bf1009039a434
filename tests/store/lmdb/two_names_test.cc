// SPDX-License-Identifier: Apache-2.0
// One store under several names: symbolic links lead to the same lock file; programs that come by a
// hard link, or with a lock file that is not the one in use, are told so, and nothing is lost.
#include <array>
#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <functional>
#include <sys/wait.h>
#include <unistd.h>

#include "store/lmdb/environment.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

namespace fs = std::filesystem;

// A child process that runs `body` once Go() is called.
class Child {
 public:
  explicit Child(const std::function<int()>& body) {
    REQUIRE(::pipe(go_) == 0);
    pid_ = ::fork();
    if (pid_ == 0) {
      char byte = 0;
      ::close(go_[1]);
      if (::read(go_[0], &byte, 1) != 1) ::_exit(99);
      ::_exit(body());
    }
    ::close(go_[0]);
  }
  void Go() { REQUIRE(::write(go_[1], "g", 1) == 1); }
  int Wait() {
    int status = 0;
    ::waitpid(pid_, &status, 0);
    ::close(go_[1]);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
  }

 private:
  int go_[2] = {-1, -1};
  pid_t pid_ = -1;
};

constexpr int kWritten = 0;
constexpr int kBusy = 75;

int Write(const std::string& path, const std::string& name, const SyntheticObject& object) {
  const auto database = Database::Open(path, {.writable = true});
  if (!database.ok()) return database.status().code() == StatusCode::kBusy ? kBusy : 1;
  for (int i = 0; i < 3; ++i) {
    if (!WriteObject(**database, name, object, true).ok()) return 2;
  }
  return kWritten;
}

// Two processes write at the same time, each by its own name. Returns how many of them did; each
// object whose writer said so is there, and nothing else is.
int WriteByTwoNames(const std::array<std::string, 2>& paths, uint64_t seed) {
  const SyntheticObject objects[] = {MakeObject({.seed = seed, .max_payload = 9000}),
                                     MakeObject({.seed = seed + 1, .max_payload = 9000})};
  const std::string names[] = {"a", "b"};
  Child first([&] { return Write(paths[0], names[0], objects[0]); });
  Child second([&] { return Write(paths[1], names[1], objects[1]); });
  first.Go();
  second.Go();
  const int codes[] = {first.Wait(), second.Wait()};
  CHECK(VerifyFailures(paths[0]) == "");
  const auto database = OpenReadOnly(paths[1]);
  int written = 0;
  for (int i = 0; i < 2; ++i) {
    INFO(paths[static_cast<size_t>(i)]);
    CHECK((codes[i] == kWritten || codes[i] == kBusy));
    const auto source = database->OpenObject(names[i]);
    if (codes[i] == kWritten) {
      ++written;
      REQUIRE(source.status().message() == "");
      CHECK(CompareObject(**source, objects[i]).message() == "");
    } else {
      CHECK(source.status().code() == StatusCode::kNotFound);
    }
  }
  return written;
}

TEST_CASE("two writers by symbolic links and relative paths lose nothing", "[store]") {
  const TempDir dir;
  const std::string real = dir.File("real/a.mtdb");
  fs::create_directories(dir.File("real"));
  fs::create_directory_symlink(dir.File("real"), dir.File("folder"));
  fs::create_symlink("real/a.mtdb", dir.File("link.mtdb"));
  fs::create_symlink("link.mtdb", dir.File("chain.mtdb"));
  fs::create_symlink(dir.File("chain.mtdb"), dir.File("chain2.mtdb"));
  const fs::path here = fs::current_path();
  fs::current_path(dir.File("real"));
  uint64_t seed = 1;
  for (const std::string& other :
       {dir.File("link.mtdb"), dir.File("chain2.mtdb"), dir.File("folder/a.mtdb"),
        std::string("a.mtdb"), std::string("./../folder/../chain.mtdb"), real}) {
    for (int round = 0; round < 2; ++round) {
      INFO(other << ", round " << round);
      for (const char* suffix : {"", "-lock"}) fs::remove(real + suffix);
      CHECK(WriteByTwoNames({real, other}, seed += 2) == 2);
      CHECK(fs::exists(real + "-lock"));
    }
  }
  fs::current_path(here);
  int lock_files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(dir.File(""))) {
    if (entry.path().string().ends_with("-lock")) ++lock_files;
  }
  CHECK(lock_files == 1);
}

TEST_CASE("two writers by hard links: one writes, the other is told why not", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const std::string link = dir.File("hard.mtdb");
  for (uint64_t round = 0; round < 10; ++round) {
    INFO("round " << round);
    for (const std::string& name : {path, link}) {
      for (const char* suffix : {"", "-lock"}) fs::remove(name + suffix);
    }
    OpenWritable(path);
    fs::create_hard_link(path, link);
    CHECK(WriteByTwoNames({path, link}, 100 + 2 * round) >= 1);
  }
}

TEST_CASE("a writer by another name is refused as long as the first has the store open",
          "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const std::string link = dir.File("hard.mtdb");
  const SyntheticObject object = MakeObject({.seed = 1});
  // Forked while the store is closed: a child does not take LMDB over from its parent.
  Child same([&] { return Write(path, "same", object); });
  Child second([&] {
    const auto other = Database::Open(link, {.writable = true});
    if (other.status().message().find("by another name") == std::string::npos) return 1;
    return other.status().code() == StatusCode::kBusy ? 0 : 2;
  });
  const auto database = OpenWritable(path);
  fs::create_hard_link(path, link);
  second.Go();
  CHECK(second.Wait() == 0);
  same.Go();  // of the same name there may be many
  REQUIRE(WriteObject(*database, "x", object).status().message() == "");
  CHECK(same.Wait() == kWritten);
  // In one process the file is opened once, whatever its names.
  CHECK(WriteObject(*OpenWritable(link), "y", object).status().message() == "");
  CHECK(database->List()->size() == 3);
  CHECK(VerifyFailures(path) == "");
}

TEST_CASE("a killed writer leaves no claim to its name", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const std::string link = dir.File("hard.mtdb");
  OpenWritable(path);
  fs::create_hard_link(path, link);
  const SyntheticObject object = MakeObject({.seed = 1});
  for (const std::string& name : {path, link, path}) {
    const int status = RunChild([&] {
      const auto database = Database::Open(name, {.writable = true});
      if (!database.ok() || !WriteObject(**database, "x", object, true).ok()) return 1;
      return ::kill(::getpid(), SIGKILL);
    });
    CHECK(WIFSIGNALED(status));
  }
  CHECK(CompareObject(**OpenReadOnly(link)->OpenObject("x"), object).message() == "");
}

TEST_CASE("a lock file that is deleted while in use lets no second writer in", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject objects[] = {MakeObject({.seed = 1, .max_payload = 9000}),
                                     MakeObject({.seed = 2, .max_payload = 9000})};
  Child second([&] { return Write(path, "second", objects[1]); });
  Child third([&] { return Write(path, "second", objects[1]); });
  auto database = OpenWritable(path);
  auto writer = database->Create("first", false).value();
  fs::remove(path + "-lock");
  second.Go();
  CHECK(second.Wait() == kBusy);
  writer.reset();
  // Whoever was first goes on, and loses nothing.
  CHECK(WriteObject(*database, "first", objects[0]).status().message() == "");
  database.reset();
  third.Go();
  CHECK(third.Wait() == kWritten);
  const auto reader = OpenReadOnly(path);
  CHECK(CompareObject(**reader->OpenObject("first"), objects[0]).message() == "");
  CHECK(CompareObject(**reader->OpenObject("second"), objects[1]).message() == "");
  CHECK(VerifyFailures(path) == "");
}

}  // namespace
}  // namespace mtdb::test
