// SPDX-License-Identifier: Apache-2.0
// Files that appear whole or not at all, and what processes leave that die while they write them.
#include "codecs/mesh_file/atomic_file.h"

#include <array>
#include <catch2/catch.hpp>
#include <csignal>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <set>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/temporary_folder.h"

namespace mtdb::testing {
namespace {

std::set<std::string> FilesIn(const std::string& folder) {
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    files.insert(entry.path().filename().string());
  }
  return files;
}

std::string Read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST_CASE("A pipe is written to by each of its names") {
  const TemporaryFolder folder;
  int ends[2];
  REQUIRE(::pipe(ends) == 0);
  // As /dev/stdout: a link to "pipe:[123]", which is no path.
  const std::string own = "/proc/self/fd/" + std::to_string(ends[1]);
  const std::string link = folder.path() + "/link.ply";
  std::filesystem::create_symlink(own, link);
  for (const std::string& path : {own, link}) {
    auto file = AtomicFile::Create(path);
    INFO(file.status().message());
    REQUIRE(file.ok());
    REQUIRE((*file)->Append("mesh").ok());
    REQUIRE((*file)->Commit().ok());
    std::array<char, 8> text{};
    REQUIRE(::read(ends[0], text.data(), text.size()) == 4);
    CHECK(std::string(text.data()) == "mesh");
  }
  ::close(ends[0]);
  ::close(ends[1]);
  CHECK(FilesIn(folder.path()) == std::set<std::string>{"link.ply"});
}

TEST_CASE("A file has its name when it is whole, and replaces another of that name") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/out.ply";
  for (const char* text : {"first", "second", "third"}) {
    const std::string before = Read(path);
    auto file = AtomicFile::Create(path).value();
    REQUIRE(file->Append(text).ok());
    CHECK(Read(path) == before);
    REQUIRE(file->Commit().ok());
    CHECK(Read(path) == text);
    file.reset();
    CHECK(FilesIn(folder.path()) == std::set<std::string>{"out.ply"});
  }
  // Not committed: as if it had never been.
  auto file = AtomicFile::Create(path).value();
  REQUIRE(file->Append("fourth").ok());
  file.reset();
  CHECK(Read(path) == "third");
  CHECK(FilesIn(folder.path()).size() == 1);
}

TEST_CASE("What a killed writer leaves is nothing, or is gone with the next one") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/out.ply";
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    auto file = AtomicFile::Create(path);
    if (!file.ok() || !(*file)->Append(std::string(3000000, 'x')).ok()) _exit(1);
    raise(SIGKILL);
  }
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  REQUIRE(WIFSIGNALED(status));
  CHECK(FilesIn(folder.path()).size() <= 1);  // one where the system has no files without names
  auto file = AtomicFile::Create(path).value();
  REQUIRE(file->Append("y").ok());
  REQUIRE(file->Commit().ok());
  CHECK(FilesIn(folder.path()) == std::set<std::string>{"out.ply"});
}

TEST_CASE("Temporary files of the dead are removed, those of the living and of others are not") {
  const TemporaryFolder folder;
  const auto make = [&](const std::string& name) {
    std::ofstream(folder.path() + "/" + name) << "x";
  };
  const std::set<std::string> kept{"out.ply.tmp",     "out.ply.12.tmp",     "out.ply.12-.tmp",
                                   "out.ply.a-1.tmp", "other.ply.12-0.tmp", "out.ply.1-2-3.tmp",
                                   "out.ply.77-5.tmp"};
  for (const std::string& name : kept) make(name);
  make("out.ply.12-0.tmp");
  make("out.ply.4000000-17.tmp");
  const int living = open((folder.path() + "/out.ply.77-5.tmp").c_str(), O_RDWR);
  REQUIRE(flock(living, LOCK_EX | LOCK_NB) == 0);
  auto file = AtomicFile::Create(folder.path() + "/out.ply").value();
  REQUIRE(file->Commit().ok());
  std::set<std::string> expected = kept;
  expected.insert("out.ply");
  CHECK(FilesIn(folder.path()) == expected);
  close(living);
}

}  // namespace
}  // namespace mtdb::testing
