// SPDX-License-Identifier: Apache-2.0
// A builder is killed, or its disk fills up: the store opens, lists whole objects only, loses no
// page, and takes the same object again.
#include <catch2/catch.hpp>
#include <chrono>
#include <csignal>
#include <fstream>
#include <random>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "store/lmdb/environment.h"
#include "store/lmdb/test_hooks.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

// One transaction holds 32 MiB: this object takes two, of which the second has the texture.
SyntheticObject LargeObject(uint64_t seed) {
  SyntheticObject o = MakeObject(
      {.seed = seed, .clusters = 36, .max_payload = 100, .page_bytes = {0, 1, 900000, 700000}});
  std::mt19937_64 random(seed);
  for (auto& c : std::span(o.units).first(o.record.clusters)) {
    const Bytes part = c.payload;
    c.payload.resize(700000 + random() % 400000, std::byte{0x5a});
    std::copy(part.begin(), part.end(), c.payload.begin());
  }
  return o;
}

void CheckStore(const std::string& path, const SyntheticObject& kept,
                const SyntheticObject& fresh) {
  CHECK(VerifyFailures(path) == "");
  const auto database = OpenWritable(path);
  const auto list = database->List();
  REQUIRE(list.status().message() == "");
  REQUIRE(!list->empty());
  for (const ObjectRecord& record : *list) {
    const auto source = database->OpenObject(record.name);
    REQUIRE(source.status().message() == "");
    const bool is_kept = record.name == "kept";
    CHECK((is_kept || record.name == "fresh"));
    CHECK(CompareObject(**source, is_kept ? kept : fresh).message() == "");
  }
}

void CheckRecovery(const std::string& path, const SyntheticObject& kept,
                   const SyntheticObject& fresh) {
  CheckStore(path, kept, fresh);
  const auto database = OpenWritable(path);
  REQUIRE(WriteObject(*database, "fresh", fresh, true).status().message() == "");
  CheckStore(path, kept, fresh);
  CheckReport report;
  REQUIRE(VerifyStore(path, "", &report).ok());
  CHECK(report.checks[1] == "catalog: 2 objects, 0 being built, 0 being removed");
  REQUIRE(database->Remove("fresh").message() == "");
}

TEST_CASE("a builder killed at any named point leaves a whole store", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject kept = MakeObject({.seed = 1});
  const SyntheticObject fresh = LargeObject(2);
  REQUIRE(WriteObject(*OpenWritable(path), "kept", kept).ok());
  for (const std::string point :
       {"created", "values put", "values committed", "catalog put", "published"}) {
    for (const int skip : {0, 1}) {
      INFO(point << ", time " << skip);
      const int status = RunChild([&] {
        int left = skip;
        TestPointHook() = [&](const char* reached) {
          if (point == reached && left-- == 0) ::kill(::getpid(), SIGKILL);
        };
        const auto database = Database::Open(path, {.writable = true});
        if (!database.ok()) return 1;
        // The second time the object is there and is replaced.
        if (!WriteObject(**database, "fresh", fresh, true).ok()) return 2;
        return WriteObject(**database, "fresh", fresh, true).ok() ? 0 : 3;
      });
      REQUIRE(WIFSIGNALED(status));
      CheckRecovery(path, kept, fresh);
    }
  }
  const int status = RunChild([&] {
    TestPointHook() = [&](const char* reached) {
      if (std::string("removed") == reached) ::kill(::getpid(), SIGKILL);
    };
    const auto database = Database::Open(path, {.writable = true});
    if (!WriteObject(**database, "fresh", fresh).ok()) return 1;
    return (*database)->Remove("fresh").ok() ? 2 : 3;
  });
  REQUIRE(WIFSIGNALED(status));
  CHECK(OpenReadOnly(path)->List()->size() == 1);
  CheckRecovery(path, kept, fresh);
}

// One value a cluster, so that an object's keys fill pages of the tree.
SyntheticObject ManyValues(uint64_t seed) {
  SyntheticObject o = MakeObject(
      {.seed = seed, .clusters = 60, .max_payload = 100, .page_bytes = {600000, 0, 600000}});
  for (auto& c : std::span(o.units).first(o.record.clusters))
    c.payload.resize(70000, static_cast<std::byte>(seed));
  return o;
}

TEST_CASE("a removal that is cut short leaves a whole store", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject kept = ManyValues(1);
  const SyntheticObject passing = ManyValues(2);
  for (int tables = 1; tables <= 3; ++tables) {
    INFO("killed after " << tables << " tables");
    const int status = RunChild([&] {
      const auto database = Database::Open(path, {.writable = true});
      if (!database.ok()) return 1;
      if (!WriteObject(**database, "kept", kept, true).ok()) return 2;
      if (!WriteObject(**database, "passing", passing).ok()) return 3;
      if (!WriteObject(**database, "fresh", kept, true).ok()) return 4;
      int left = tables;
      TestPointHook() = [&](const char* reached) {
        if (std::string("values removed") == reached && --left == 0) ::kill(::getpid(), SIGKILL);
      };
      return (*database)->Remove("passing").ok() ? 5 : 6;
    });
    REQUIRE(WIFSIGNALED(status));
    CheckStore(path, kept, kept);
    CheckRecovery(path, kept, kept);
  }
}

TEST_CASE("a builder killed at a random moment leaves a whole store", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject kept = MakeObject({.seed = 1});
  const SyntheticObject fresh = LargeObject(2);
  REQUIRE(WriteObject(*OpenWritable(path), "kept", kept).ok());
  std::mt19937_64 random(77);
  int killed = 0;
  for (int i = 0; i < 20; ++i) {
    const pid_t child = ::fork();
    if (child == 0) {
      for (;;) {
        const auto database = Database::Open(path, {.writable = true});
        if (!database.ok() || !WriteObject(**database, "fresh", fresh, true).ok()) ::_exit(1);
      }
    }
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 250000));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    if (WIFSIGNALED(status)) ++killed;
    INFO("kill " << i);
    if (i % 5 == 4) {
      CheckRecovery(path, kept, fresh);
    } else {
      CheckStore(path, kept, fresh);
    }
  }
  CHECK(killed == 20);
}

TEST_CASE("a full disk gives one clear line and harms nothing", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject kept = MakeObject({.seed = 1});
  const SyntheticObject fresh = LargeObject(2);
  REQUIRE(WriteObject(*OpenWritable(path), "kept", kept).ok());
  const uint64_t size = ReadFile(path).size();
  for (const uint64_t room : {uint64_t{0}, uint64_t{5000}, uint64_t{1} << 20, uint64_t{33} << 20}) {
    INFO("room for " << room << " bytes");
    int report[2];
    REQUIRE(::pipe(report) == 0);
    const int status = RunChild([&] {
      std::signal(SIGXFSZ, SIG_IGN);
      const rlimit limit{size + room, size + room};
      ::setrlimit(RLIMIT_FSIZE, &limit);
      const auto database = Database::Open(path, {.writable = true});
      if (!database.ok()) return 1;
      const auto record = WriteObject(**database, "fresh", fresh);
      if (record.ok()) return 2;
      const std::string& m = record.status().message();
      if (::write(report[1], m.data(), m.size()) != static_cast<ssize_t>(m.size())) return 3;
      if (record.status().code() != StatusCode::kNoSpace) return 4;
      // The environment goes on serving readers.
      const auto source = (*database)->OpenObject("kept");
      if (!source.ok() || !CompareObject(**source, kept).ok()) return 5;
      return 0;
    });
    ::close(report[1]);
    char text[1000] = {};
    const ssize_t n = ::read(report[0], text, sizeof(text) - 1);
    ::close(report[0]);
    const std::string message(text, static_cast<size_t>(n > 0 ? n : 0));
    INFO(message);
    REQUIRE(status == 0);
    CHECK(message.find(path) == 0);
    CHECK(message.find('\n') == std::string::npos);
    CHECK(message.find("free some space") != std::string::npos);
    CheckStore(path, kept, fresh);
  }
  CheckRecovery(path, kept, fresh);
}

TEST_CASE("a reader that died does not keep pages for ever", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject kept = MakeObject({.seed = 1});
  const SyntheticObject passing = MakeObject({.seed = 3, .max_payload = 60000});
  REQUIRE(WriteObject(*OpenWritable(path), "kept", kept).ok());
  int ready[2];
  REQUIRE(::pipe(ready) == 0);
  const pid_t child = ::fork();
  char byte = 'r';
  if (child == 0) {
    const auto environment = Environment::Open(path, {});
    if (!environment.ok()) ::_exit(1);
    const auto snapshot = (*environment)->NewestPinned();
    if (!snapshot.ok() || ::write(ready[1], &byte, 1) != 1) ::_exit(2);
    ::pause();
    ::_exit(3);
  }
  REQUIRE(::read(ready[0], &byte, 1) == 1);
  const auto database = OpenWritable(path);
  const auto cycle = [&] {
    REQUIRE(WriteObject(*database, "passing", passing).ok());
    REQUIRE(database->Remove("passing").ok());
    return *database->FileBytes();
  };
  const uint64_t first = cycle();
  const uint64_t pinned = cycle();
  CHECK(pinned > first + first / 2);  // the live reader's snapshot is respected
  ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
  cycle();
  const uint64_t settled = cycle();
  for (int i = 0; i < 5; ++i) CHECK(cycle() <= settled);
  CHECK(VerifyFailures(path) == "");
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they need the address space
uint64_t AddressSpaceBytes() {
  std::ifstream in("/proc/self/statm");
  uint64_t pages = 0;
  in >> pages;
  return pages * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
}

TEST_CASE("little address space will do, and the map grows when more is there", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject kept = MakeObject({.seed = 1});
  const SyntheticObject fresh = LargeObject(2);
  const bool grows = GENERATE(true, false);
  const int status = RunChild([&] {
    rlimit limit{};
    ::getrlimit(RLIMIT_AS, &limit);
    limit.rlim_cur = AddressSpaceBytes() + (48 << 20);
    ::setrlimit(RLIMIT_AS, &limit);
    const auto database = Database::Open(path, {.writable = true});
    if (!database.ok()) return 1;
    if (!WriteObject(**database, "kept", kept).ok()) return 2;
    if (grows) {
      limit.rlim_cur = limit.rlim_max;
    } else {
      limit.rlim_cur = AddressSpaceBytes() + (150 << 20);  // for the objects, not for a map
    }
    ::setrlimit(RLIMIT_AS, &limit);
    const auto source = (*database)->OpenObject("kept");
    for (int i = 0; i < (grows ? 3 : 8); ++i) {
      const auto record = WriteObject(**database, "fresh" + std::to_string(i), fresh);
      if (!record.ok()) {
        if (grows || record.status().code() != StatusCode::kNoSpace) return 3;
        return source.ok() && CompareObject(**source, kept).ok() ? 0 : 4;
      }
    }
    return grows && CompareObject(**source, kept).ok() ? 0 : 5;
  });
  CHECK(status == 0);
  CHECK(VerifyFailures(path) == "");
}
#endif

TEST_CASE("what is left of a store that was being made is made a store", "[store]") {
  const TempDir dir;
  REQUIRE(OpenWritable(dir.File("new.mtdb")) != nullptr);
  const auto read = [](const std::string& path) { return std::string(AsString(ReadFile(path))); };
  const std::string fresh = read(dir.File("new.mtdb"));
  REQUIRE(fresh.size() >= 8192);
  const SyntheticObject object = MakeObject({.seed = 1});
  for (const char* name : {"a", "b"}) {
    REQUIRE(WriteObject(*OpenWritable(dir.File("full.mtdb")), name, object).ok());
  }
  const std::string full = read(dir.File("full.mtdb"));
  int number = 0;
  const auto make = [&](const std::string& bytes) {
    const std::string path = dir.File(std::to_string(number++) + ".mtdb");
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  };
  const size_t page = fresh.size() / 2;
  for (const std::string& left :
       {std::string(), fresh.substr(0, 200), fresh.substr(0, page), fresh.substr(0, page + 100),
        fresh.substr(0, page) + std::string(page, '\0'), std::string(page, '\0'),
        std::string(2 * page, '\0'), fresh}) {
    const std::string path = make(left);
    INFO(left.size() << " bytes");
    CHECK(Database::NothingStored(path));
    const auto database = Database::Open(path, {.writable = true, .create = true});
    REQUIRE(database.status().message() == "");
    REQUIRE(WriteObject(**database, "a", object).status().message() == "");
    CHECK(VerifyFailures(path) == "");
    CHECK_FALSE(Database::NothingStored(path));
  }
  // What was stored once is not made anew.
  for (const size_t left : {size_t{200}, page, 2 * page, 3 * page}) {
    INFO(left << " bytes of a store");
    const std::string path = make(full.substr(0, left));
    CHECK_FALSE(Database::NothingStored(path));
    CHECK_FALSE(Database::Open(path, {.writable = true, .create = true}).ok());
    CHECK(read(path) == full.substr(0, left));
  }
  CHECK_FALSE(Database::NothingStored(dir.File("none.mtdb")));
  CHECK_FALSE(Database::Open(make("no store"), {.writable = true, .create = true}).ok());
}

}  // namespace
}  // namespace mtdb::test
