// SPDX-License-Identifier: Apache-2.0
// Copies of objects and stores, stores without free space, other names: everything that was there
// is there afterwards, whoever is killed or writes meanwhile.
#include "store/copy.h"

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "store/lmdb/test_hooks.h"
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
  SyntheticObject a = MakeObject({.seed = 1, .page_bytes = {0, 1, 300000}}),
                  b = MakeObject({.seed = 2, .clusters = 400}), c = MakeObject({.seed = 3});
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
TEST_CASE("the lock file of a store has its room before LMDB maps it", "[store]") {
  const auto has_room = [](const std::string& lock) {
    struct stat info {};
    REQUIRE(::stat(lock.c_str(), &info) == 0);
    CHECK(info.st_size >= 32 << 10);
    CHECK(info.st_blocks * 512 >= info.st_size);
  };
  const Store store;
  const std::string lock = store.path + "-lock";
  for (const bool sparse : {false, true}) {
    fs::remove(lock);
    // As a program leaves it that dies when it has made the file.
    if (sparse) WriteFile(lock, {});
    if (sparse) fs::resize_file(lock, 33000);
    const auto database = OpenWritable(store.path);
    has_room(lock);
  }
}

TEST_CASE("a full disk ends a change of a store with an error and nothing left", "[store]") {
  const Store store;
  const std::string folder = fs::path(store.path).parent_path().string();
  const Bytes bytes = ReadFile(store.path);
  const int status = RunChild([&] {
    const std::string disk = folder + "/disk";
    fs::create_directory(disk);
    if (::unshare(CLONE_NEWNS) != 0 ||
        ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
        ::mount("none", disk.c_str(), "tmpfs", 0, "size=4m") != 0) {
      return 77;
    }
    const std::string path = disk + "/s.mtdb", filler = disk + "/filler";
    // From no room at all to a little more than the store has.
    for (uint64_t room = 0; room < bytes.size() + (128 << 10); room += 8 << 10) {
      for (int what = 0; what < 4; ++what) {
        fs::remove(filler);
        for (const auto& file : fs::directory_iterator(disk)) fs::remove(file);
        WriteFile(path, bytes);
        const uint64_t free = fs::space(disk).available;
        WriteFile(filler, Bytes(free - std::min<uint64_t>(free, room)));
        const auto change = [&]() -> Status {
          if (what == 0) return CompactStore(path).status();
          if (what == 1) {
            MTDB_ASSIGN_OR_RETURN(const auto sources, OpenReadOnly(path)->OpenAll());
            return CopyToNewStore(sources, disk + "/copy.mtdb");
          }
          MTDB_ASSIGN_OR_RETURN(const auto database, Database::Open(path, {.writable = true}));
          return what == 2 ? database->Remove("a") : database->Rename("a", "z");
        };
        const Status changed = change();
        if (!changed.ok() && changed.code() != StatusCode::kNoSpace) return 10 + what;
        for (const auto& file : fs::directory_iterator(disk)) {
          if (file.path().string().find("partial") != std::string::npos) return 20 + what;
        }
        if (VerifyFailures(path) != "") return 30 + what;
        if (fs::exists(disk + "/copy.mtdb") != (what == 1 && changed.ok())) return 40 + what;
      }
    }
    return 0;
  });
  if (WIFEXITED(status) && WEXITSTATUS(status) == 77) {
    WARN("skipped: this process may not mount");
  } else {
    CHECK(status == 0);
  }
}

TEST_CASE("what has the name of a partial store and is none is kept", "[store]") {
  const Store store;
  const std::string copy = store.dir.File("copy.mtdb"), partial = copy + ".partial";
  const auto copies = [&] {
    return CopyToNewStore(OpenReadOnly(store.path)->OpenAll().value(), copy);
  };
  const Bytes bytes = ReadFile(store.path);
  WriteFile(partial, bytes);  // somebody's store
  CHECK(copies().code() == StatusCode::kAlreadyExists);
  CHECK(ReadFile(partial) == bytes);
  fs::remove(partial);
  fs::create_hard_link(store.path, partial);
  CHECK(copies().code() == StatusCode::kAlreadyExists);
  fs::remove(partial);
  fs::create_symlink(store.path, partial);
  CHECK(copies().code() == StatusCode::kAlreadyExists);
  CHECK(ReadFile(store.path) == bytes);
  fs::remove(partial);
  REQUIRE(copies().message() == "");
  CHECK((fs::status(copy).permissions() & fs::perms::sticky_bit) == fs::perms::none);
  CheckHolds(copy, {{"a", store.a}, {"c", store.c}});
}

}  // namespace mtdb::test
