// SPDX-License-Identifier: Apache-2.0
// Files that appear whole or not at all, and what processes leave that die while they write them.
#include "codecs/mesh_file/atomic_file.h"

#include <array>
#include <catch2/catch.hpp>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <set>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

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

// The first meta page of LMDB, of this page size and version; the second follows.
std::string StoreBytes(size_t page, uint32_t version = 1) {
  std::string bytes(2 * page + 100, '\0');
  for (size_t number = 0; number < 2; ++number) {
    char* const at = bytes.data() + number * page;
    at[0] = static_cast<char>(number);
    at[10] = 8;
    constexpr uint32_t kMagic = 0xbeefc0de;
    std::memcpy(at + 16, &kMagic, sizeof(kMagic));
    std::memcpy(at + 20, &version, sizeof(version));
  }
  return bytes;
}

void Put(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

// Neither Create() nor what an open descriptor leads to takes its place, by none of its names.
void IsKept(const TemporaryFolder& folder, const std::string& bytes, const AtomicFileOptions& how) {
  const std::string path = folder.path() + "/kept", soft = folder.path() + "/soft.ply",
                    hard = folder.path() + "/hard.ply";
  Put(path, bytes);
  std::filesystem::create_symlink("kept", soft);
  std::filesystem::create_hard_link(path, hard);
  for (const std::string& name : {path, soft, hard}) {
    const Status status = AtomicFile::Create(name, how).status();
    INFO(name << ": " << status.message());
    CHECK(status.code() == StatusCode::kAlreadyExists);
    CHECK_THAT(status.message(), Catch::StartsWith(name + ": "));
    CHECK(Read(path) == bytes);
    for (const int flags : {O_WRONLY, O_RDWR, O_WRONLY | O_APPEND}) {
      const int descriptor = ::open(name.c_str(), flags | O_CLOEXEC);
      CHECK(AtomicFile::Into(descriptor, "out").status().code() == StatusCode::kAlreadyExists);
      ::close(descriptor);
    }
  }
  CHECK(FilesIn(folder.path()) == std::set<std::string>{"kept", "soft.ply", "hard.ply"});
}

TEST_CASE("No file takes the place of a store, damaged, cut short or of another version") {
  std::vector<std::string> stores;
  for (const size_t page : {512, 4096, 16384, 65536}) {
    const std::string whole = StoreBytes(page);
    stores.push_back(whole);
    stores.push_back(StoreBytes(page, 7));
    stores.push_back(std::string(page, 'x') + whole.substr(page));  // the first page is lost
    stores.push_back(std::string(page, '\0') + whole.substr(page));
    stores.push_back(whole.substr(0, page) + std::string(page + 100, 'x'));
    std::string flipped = whole;
    flipped[17] ^= 1;  // in the magic of both
    flipped[page + 17] ^= 1;
    stores.push_back(flipped);
  }
  for (const size_t size : {16, 20, 100, 4096, 8192}) {
    stores.push_back(StoreBytes(4096).substr(0, size));
  }
  for (const std::string& bytes : stores) {
    for (const bool packs : {false, true}) {
      const TemporaryFolder folder;
      IsKept(folder, bytes, {packs, ""});
    }
  }
}

TEST_CASE("Packed files are replaced by packed files alone, and by none that is read meanwhile") {
  for (const std::string& bytes :
       {std::string("mtdb packed\0\0\0\0\0and more", 24), std::string("mtdb packed")}) {
    const TemporaryFolder folder;
    IsKept(folder, bytes, {});
    const std::string path = folder.path() + "/kept", other = folder.path() + "/other";
    CHECK(AtomicFile::Create(path, {true, folder.path() + "/hard.ply"}).status().code() ==
          StatusCode::kAlreadyExists);
    Put(other, bytes);
    auto file = AtomicFile::Create(path, {true, other});
    INFO(file.status().message());
    REQUIRE(file.ok());
    REQUIRE((*file)->Append("mtdb packed anew").ok());
    REQUIRE((*file)->Commit().ok());
    CHECK(Read(path) == "mtdb packed anew");
  }
}

TEST_CASE("Journals, lock files, and what a lock file lies beside are not replaced") {
  const TemporaryFolder folder;
  const std::string store = folder.path() + "/s.mtdb", lock = store + "-lock";
  Put(store, "mtdb journal 10");
  CHECK_FALSE(AtomicFile::Create(store).ok());
  Put(lock, std::string(8192, 'l'));
  Put(store, StoreBytes(4096));
  CHECK_FALSE(AtomicFile::Create(lock).ok());
  std::filesystem::create_symlink(lock, folder.path() + "/l.ply");
  CHECK_FALSE(AtomicFile::Create(folder.path() + "/l.ply").ok());
  Put(store, std::string(20000, 'x'));  // all of its beginning was written over
  CHECK_FALSE(AtomicFile::Create(store).ok());
  // Nobody's any more.
  std::filesystem::remove(store);
  CHECK(AtomicFile::Create(store).ok());
  CHECK(AtomicFile::Create(lock).ok());
}

TEST_CASE("A store that is made while a file is written is not replaced when that is whole") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/out.ply";
  auto file = AtomicFile::Create(path).value();
  REQUIRE(file->Append("mesh").ok());
  Put(path, StoreBytes(4096));
  CHECK(file->Commit().code() == StatusCode::kAlreadyExists);
  file.reset();
  CHECK(Read(path) == StoreBytes(4096));
  CHECK(FilesIn(folder.path()) == std::set<std::string>{"out.ply"});
}

TEST_CASE("What is no file of mtdb is replaced as ever") {
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/out";
  for (const std::string& bytes :
       {std::string(), std::string(10000, '\0'), std::string("ply\n"), std::string("glTF"),
        std::string("mtdb"), StoreBytes(4096).substr(0, 15), std::string(3, '\xde')}) {
    Put(path, bytes);
    auto file = AtomicFile::Create(path);
    INFO(file.status().message());
    REQUIRE(file.ok());
    REQUIRE((*file)->Append("new").ok());
    REQUIRE((*file)->Commit().ok());
    CHECK(Read(path) == "new");
  }
}

}  // namespace
}  // namespace mtdb::testing
