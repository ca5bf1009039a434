// SPDX-License-Identifier: Apache-2.0
// Copies of objects and stores, stores without free space, other names: everything that was there
// is there afterwards, whoever is killed or writes meanwhile.
#include "store/copy.h"

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "store/internal/test_hooks.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

namespace fs = std::filesystem;

uint64_t FreeBytes(const std::string& path) {
  const auto free = OpenReadOnly(path)->FreeBytes();
  REQUIRE(free.status().message() == "");
  return *free;
}

void CheckHolds(const std::string& path,
                const std::vector<std::pair<std::string, SyntheticObject>>& expected) {
  CHECK(VerifyFailures(path) == "");
  const auto database = OpenReadOnly(path);
  const auto list = database->List();
  REQUIRE(list.status().message() == "");
  REQUIRE(list->size() == expected.size());
  for (const auto& [name, object] : expected) {
    INFO(name);
    const auto source = database->OpenObject(name);
    REQUIRE(source.status().message() == "");
    CHECK(CompareObject(**source, object).message() == "");
  }
}

std::vector<std::string> FilesIn(const TempDir& dir) {
  std::vector<std::string> names;
  for (const auto& file : fs::directory_iterator(dir.File(""))) {
    names.push_back(file.path().filename().string());
  }
  std::ranges::sort(names);
  return names;
}

// Objects "a", "b" and "c" of which the largest, "b", was removed.
struct Store {
  TempDir dir;
  std::string path = dir.File("s.mtdb");
  SyntheticObject a = MakeObject({.seed = 1}), b = MakeObject({.seed = 2, .clusters = 400}),
                  c = MakeObject({.seed = 3});
  Store() {
    const auto database = OpenWritable(path);
    REQUIRE(WriteObject(*database, "a", a).ok());
    REQUIRE(WriteObject(*database, "b", b).ok());
    REQUIRE(WriteObject(*database, "c", c).ok());
    REQUIRE(database->Remove("b").message() == "");
  }
};

TEST_CASE("compacting frees what removed objects left, and nothing else changes", "[store]") {
  const Store store;
  const uint64_t free = FreeBytes(store.path);
  CHECK(free > 300000);
  REQUIRE(::chmod(store.path.c_str(), 0640) == 0);
  const auto digest = OpenReadOnly(store.path)->Find("a")->digest_hex();
  uint64_t last = 0;
  const auto report = CompactStore(store.path, [&](uint64_t done, uint64_t total) {
    CHECK(done >= last);
    CHECK(done <= total);
    last = done;
    return Status::Ok();
  });
  REQUIRE(report.status().message() == "");
  CHECK(last > 0);
  CHECK(report->bytes_after == fs::file_size(store.path));
  CHECK(report->bytes_before - report->bytes_after + (64 << 10) > free);
  CHECK(FreeBytes(store.path) < (64 << 10));
  struct stat info {};
  REQUIRE(::stat(store.path.c_str(), &info) == 0);
  CHECK((info.st_mode & 0777) == 0640);
  CheckHolds(store.path, {{"a", store.a}, {"c", store.c}});
  CHECK(OpenReadOnly(store.path)->Find("a")->digest_hex() == digest);
  CHECK(FilesIn(store.dir) == std::vector<std::string>{"s.mtdb", "s.mtdb-lock"});
  // It takes further objects, and may be compacted again.
  REQUIRE(WriteObject(*OpenWritable(store.path), "b", store.b).status().message() == "");
  REQUIRE(CompactStore(store.path).status().message() == "");
  CheckHolds(store.path, {{"a", store.a}, {"b", store.b}, {"c", store.c}});
}

TEST_CASE("a store of which everything was removed becomes small", "[store]") {
  const Store store;
  REQUIRE(OpenWritable(store.path)->Remove("a").ok());
  REQUIRE(OpenWritable(store.path)->Remove("c").ok());
  const auto report = CompactStore(store.path);
  REQUIRE(report.status().message() == "");
  CHECK(report->bytes_after <= (32 << 10));
  CheckHolds(store.path, {});
  REQUIRE(WriteObject(*OpenWritable(store.path), "a", store.a).status().message() == "");
  CheckHolds(store.path, {{"a", store.a}});
}

TEST_CASE("a process killed while it compacts or copies leaves the store whole", "[store]") {
  for (const std::string point : {"created", "values put", "partial written", "partial renamed"}) {
    for (const bool compacts : {true, false}) {
      INFO(point << (compacts ? ", compacting" : ", copying"));
      const Store store;
      const std::string copy = store.dir.File("copy.mtdb");
      const int status = RunChild([&] {
        TestPointHook() = [&](const char* reached) {
          if (point == reached) ::kill(::getpid(), SIGKILL);
        };
        if (compacts) return CompactStore(store.path).ok() ? 0 : 1;
        const auto sources = OpenReadOnly(store.path)->OpenAll();
        return sources.ok() && CopyToNewStore(*sources, copy).ok() ? 0 : 1;
      });
      CHECK((WIFSIGNALED(status) || (!compacts && point == "partial renamed")));
      CheckHolds(store.path, {{"a", store.a}, {"c", store.c}});
      CHECK(fs::exists(copy) == !WIFSIGNALED(status));
      // The next one clears up and gets through.
      REQUIRE(CompactStore(store.path).status().message() == "");
      fs::remove(copy);
      REQUIRE(CopyToNewStore(*OpenReadOnly(store.path)->OpenAll(), copy).message() == "");
      CheckHolds(store.path, {{"a", store.a}, {"c", store.c}});
      CheckHolds(copy, {{"a", store.a}, {"c", store.c}});
      for (const std::string& name : FilesIn(store.dir)) CHECK(!name.ends_with(".partial"));
    }
  }
}

TEST_CASE("a store that a program writes to is not compacted", "[store]") {
  const Store store;
  const Bytes before = ReadFile(store.path);
  int ready[2], done[2];
  REQUIRE((::pipe(ready) == 0 && ::pipe(done) == 0));
  const pid_t child = ::fork();
  if (child == 0) {
    const auto database = Database::Open(store.path, {.writable = true});
    char byte = 0;
    if (!database.ok() || ::write(ready[1], "r", 1) != 1) ::_exit(1);
    ::_exit(::read(done[0], &byte, 1) == 1 ? 0 : 2);
  }
  char byte = 0;
  REQUIRE(::read(ready[0], &byte, 1) == 1);
  const auto report = CompactStore(store.path);
  CHECK(report.status().code() == StatusCode::kBusy);
  CHECK(ReadFile(store.path) == before);
  REQUIRE(::write(done[1], "d", 1) == 1);
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  CHECK(status == 0);
  CHECK(CompactStore(store.path).ok());
}

TEST_CASE("who opens a store while it is compacted waits, and writes to the new file", "[store]") {
  const Store store;
  int compacting[2];
  REQUIRE(::pipe(compacting) == 0);
  const pid_t child = ::fork();
  if (child == 0) {
    TestPointHook() = [&](const char* reached) {
      if (std::string(reached) != "partial written") return;
      if (::write(compacting[1], "c", 1) != 1) ::_exit(3);
      ::usleep(200000);  // for the parent to come to the lock; right also if it does not
    };
    ::_exit(CompactStore(store.path).ok() ? 0 : 1);
  }
  char byte = 0;
  REQUIRE(::read(compacting[0], &byte, 1) == 1);
  {
    const auto database = OpenWritable(store.path);
    REQUIRE(WriteObject(*database, "b", store.b).status().message() == "");
    CHECK(!database->IsOutdated());
  }
  int status = 0;
  REQUIRE(::waitpid(child, &status, 0) == child);
  CHECK(status == 0);
  CheckHolds(store.path, {{"a", store.a}, {"b", store.b}, {"c", store.c}});
}

TEST_CASE("a reader goes on with the file that it opened before the store was compacted",
          "[store]") {
  const Store store;
  const auto database = OpenReadOnly(store.path);
  const auto source = database->OpenObject("a");
  REQUIRE(source.ok());
  CHECK(!database->IsOutdated());
  REQUIRE(CompactStore(store.path).ok());
  CHECK(database->IsOutdated());
  CHECK(CompareObject(**source, store.a).message() == "");
}

TEST_CASE("a file with two names is not compacted", "[store]") {
  const Store store;
  fs::create_hard_link(store.path, store.dir.File("other.mtdb"));
  const Bytes before = ReadFile(store.path);
  const auto report = CompactStore(store.path);
  CHECK(report.status().code() == StatusCode::kUnsupported);
  CHECK_THAT(report.status().message(), Catch::Contains("hard link"));
  CHECK(ReadFile(store.path) == before);
}

TEST_CASE("a store is compacted through a symbolic link, which stays one", "[store]") {
  const Store store;
  const std::string link = store.dir.File("link.mtdb");
  fs::create_symlink(store.path, link);
  REQUIRE(CompactStore(link).status().message() == "");
  CHECK(fs::is_symlink(link));
  CheckHolds(link, {{"a", store.a}, {"c", store.c}});
}

TEST_CASE("a damaged object or a full disk leaves a store as it was", "[store]") {
  const Store store;
  Bytes bytes = ReadFile(store.path);
  const auto& payload = store.a.units[5].payload;
  const auto at = std::search(bytes.begin(), bytes.end(), payload.begin(), payload.end());
  REQUIRE(at != bytes.end());
  *at ^= std::byte{1};
  const std::string damaged = store.dir.File("damaged.mtdb");
  WriteFile(damaged, bytes);
  CHECK(CompactStore(damaged).status().code() == StatusCode::kCorrupt);
  CHECK(ReadFile(damaged) == bytes);
  const int status = RunChild([&] {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{100 << 10, 100 << 10};
    if (::setrlimit(RLIMIT_FSIZE, &limit) != 0) return 2;
    return CompactStore(store.path).status().code() == StatusCode::kNoSpace ? 0 : 1;
  });
  CHECK(status == 0);
  CheckHolds(store.path, {{"a", store.a}, {"c", store.c}});
  for (const std::string& name : FilesIn(store.dir)) {
    CHECK_THAT(name, !Catch::Contains("partial"));
  }
}

TEST_CASE("a copy has what the store had at one moment, whoever writes", "[store]") {
  const Store store;
  const std::string copy = store.dir.File("copy.mtdb");
  auto sources = OpenReadOnly(store.path)->OpenAll();
  REQUIRE(sources.status().message() == "");
  {
    // Another process removes all and fills the pages.
    const int status = RunChild([&] {
      const auto database = Database::Open(store.path, {.writable = true});
      if (!database.ok() || !(*database)->Remove("a").ok()) return 1;
      if (!WriteObject(**database, "c", store.b, true).ok()) return 2;
      return WriteObject(**database, "d", store.b).ok() ? 0 : 3;
    });
    CHECK(status == 0);
  }
  REQUIRE(CopyToNewStore(*sources, copy).message() == "");
  sources->clear();
  CheckHolds(copy, {{"a", store.a}, {"c", store.c}});
  CheckHolds(store.path, {{"c", store.b}, {"d", store.b}});
  CHECK(CopyToNewStore({}, copy).code() == StatusCode::kAlreadyExists);
}

TEST_CASE("an object is copied into another store with its digest", "[store]") {
  const Store store;
  const std::string other = store.dir.File("other.mtdb");
  const auto source = OpenReadOnly(store.path)->OpenObject("a");
  {
    const auto target = OpenWritable(other);
    const auto copied = CopyObject(**source, *target, "x", false);
    REQUIRE(copied.status().message() == "");
    CHECK(copied->name == "x");
    CHECK(copied->digest_hex() == (*source)->record().digest_hex());
    CHECK(CopyObject(**source, *target, "x", false).status().code() == StatusCode::kAlreadyExists);
    REQUIRE(CopyObject(**source, *target, "x", true).status().message() == "");
  }
  CheckHolds(other, {{"x", store.a}});
}

TEST_CASE("an object gets another name, and who has it open reads on", "[store]") {
  const Store store;
  const auto database = OpenWritable(store.path);
  const auto source = database->OpenObject("a");
  REQUIRE(source.ok());
  CHECK(database->Rename("x", "y").code() == StatusCode::kNotFound);
  CHECK(database->Rename("a", "c").code() == StatusCode::kAlreadyExists);
  CHECK(database->Rename("a", "").code() == StatusCode::kInvalidArgument);
  REQUIRE(database->Rename("a", "z").message() == "");
  CHECK(CompareObject(**source, store.a).message() == "");
  CheckHolds(store.path, {{"c", store.c}, {"z", store.a}});
}

}  // namespace
}  // namespace mtdb::test
