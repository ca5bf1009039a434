// SPDX-License-Identifier: Apache-2.0
// Readers that hold no lock and keep nothing from writers: another user's store, a writer by
// another name, a file that is written over or cut off while it is read.
#include <array>
#include <atomic>
#include <catch2/catch.hpp>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <fcntl.h>
#include <filesystem>
#include <functional>
#include <random>
#include <sched.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include "store/lmdb/environment.h"
#include "store/lmdb/test_hooks.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

namespace fs = std::filesystem;

constexpr uint64_t kVersions = 3;

SyntheticObject Kept() { return MakeObject({.seed = 77, .clusters = 60}); }
SyntheticObject Passing(uint64_t version) {
  return MakeObject({.seed = 1 + version % kVersions, .max_payload = 12000});
}

// "kept" is always there and right; "passing" is one of its versions, or not there. 0, or what went
// wrong.
int ReadOnce(const std::string& path, int* seen) {
  static const SyntheticObject kKept = Kept();
  static const std::array kVersionsOfPassing{Passing(0), Passing(1), Passing(2)};
  const auto database = Database::Open(path);
  if (!database.ok()) return 10;
  const auto list = (*database)->List();
  if (!list.ok()) return 11;
  int kept_listed = 0;
  int passing_listed = 0;
  for (const ObjectRecord& record : *list) {
    (record.name == "kept" ? kept_listed : passing_listed) += 1;
  }
  if (kept_listed != 1 || passing_listed > 1) return 12;
  const auto source = (*database)->OpenObject("kept");
  if (!source.ok()) return 13;
  if (!CompareObject(**source, kKept).ok()) return 14;
  const auto passing = (*database)->OpenObject("passing");
  if (!passing.ok()) return passing.status().code() == StatusCode::kNotFound ? 0 : 15;
  for (const SyntheticObject& version : kVersionsOfPassing) {
    if (version.record.nodes != (*passing)->record().nodes) continue;
    const Status status = CompareObject(**passing, version);
    if (status.ok()) ++*seen;
    return status.ok() || status.code() == StatusCode::kNotFound ? 0 : 16;
  }
  return 17;
}

// Replaces and removes "passing" by `writer_name` in a process of its own until `reader` has run.
void BesideAWriter(const std::string& writer_name, const std::function<void()>& reader) {
  const pid_t writer = ::fork();
  if (writer == 0) {
    const auto database = Database::Open(writer_name, {.writable = true});
    if (!database.ok()) ::_exit(20);
    for (uint64_t i = 0;; ++i) {
      if (!WriteObject(**database, "passing", Passing(i), true).ok()) ::_exit(21);
      if (i % 4 == 3 && !(*database)->Remove("passing").ok()) ::_exit(22);
    }
  }
  reader();
  int status = 0;
  CHECK(::waitpid(writer, &status, WNOHANG) == 0);  // it wrote all the time
  ::kill(writer, SIGKILL);
  ::waitpid(writer, &status, 0);
  CHECK(WIFSIGNALED(status));
}

void MakeStore(const std::string& path) {
  REQUIRE(WriteObject(*OpenWritable(path), "kept", Kept()).ok());
}

TEST_CASE("a reader is right while a writer by a hard link removes and ingests", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const std::string link = dir.File("hard.mtdb");
  MakeStore(path);
  fs::create_hard_link(path, link);
  int seen = 0;
  BesideAWriter(link, [&] {
    for (int i = 0; i < 150 || (seen < 20 && i < 5000); ++i) REQUIRE(ReadOnce(path, &seen) == 0);
  });
  CHECK(seen >= 20);
  CHECK(VerifyFailures(path) == "");
}

// In a child that may read the store and write nothing at all.
int AsAnotherUser(const std::function<int()>& body) {
  return RunChild([&] {
    if (::getuid() == 0 && (::setgid(65534) != 0 || ::setuid(65534) != 0)) return 90;
    return body();
  });
}

TEST_CASE("another user's store is read, also while its owner writes", "[store]") {
  const TempDir dir;
  const std::string folder = dir.File("theirs");
  const std::string path = folder + "/a.mtdb";
  fs::create_directories(folder);
  MakeStore(path);
  const bool lock_file = GENERATE(true, false);
  if (!lock_file) fs::remove(path + "-lock");
  INFO("lock file: " << lock_file);
  if (::getuid() != 0) {
    fs::permissions(path, fs::perms::owner_read);
    fs::permissions(folder, fs::perms::owner_read | fs::perms::owner_exec);
  }
  const auto read = [&] {
    const auto writable = Database::Open(path, {.writable = true, .create = false});
    if (writable.status().code() != StatusCode::kIoError) return 30;
    int seen = 0;
    for (int i = 0; i < 100 || (seen < 10 && i < 5000); ++i) {
      if (const int failure = ReadOnce(path, &seen); failure != 0) return failure;
    }
    return 0;
  };
  SECTION("at rest") {
    CHECK(AsAnotherUser([&] {
            int seen = 0;
            return VerifyFailures(path) == "" ? ReadOnce(path, &seen) : 31;
          }) == 0);
    CHECK(fs::exists(path + "-lock") == lock_file);
  }
  if (::getuid() == 0) {
    SECTION("beside a writer") {
      BesideAWriter(path, [&] { CHECK(AsAnotherUser(read) == 0); });
      CHECK(VerifyFailures(path) == "");
    }
  } else {
    WARN("not root: another user's store is read at rest only");
  }
  fs::permissions(folder, fs::perms::owner_all);
}

TEST_CASE("a store on a read-only mount is read", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  MakeStore(path);
  fs::remove(path + "-lock");
  const std::string folder = fs::path(path).parent_path().string();
  const int status = RunChild([&] {
    if (::unshare(CLONE_NEWNS) != 0 ||
        ::mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
        ::mount(folder.c_str(), folder.c_str(), nullptr, MS_BIND, nullptr) != 0 ||
        ::mount(nullptr, folder.c_str(), nullptr, MS_BIND | MS_REMOUNT | MS_RDONLY, nullptr) != 0) {
      return 77;
    }
    int seen = 0;
    if (const int failure = ReadOnce(path, &seen); failure != 0) return failure;
    const auto writable = Database::Open(path, {.writable = true});
    if (writable.status().code() != StatusCode::kIoError) return 40;
    return VerifyFailures(path) == "" ? 0 : 41;
  });
  if (WIFEXITED(status) && WEXITSTATUS(status) == 77) {
    WARN("skipped: this process may not mount");
  } else {
    CHECK(status == 0);
  }
  CHECK_FALSE(fs::exists(path + "-lock"));
}

// As cp does it: the file is emptied, then filled from the front.
void CopyOver(const Bytes& bytes, const std::string& path) {
  const int out = ::open(path.c_str(), O_WRONLY | O_TRUNC);
  REQUIRE(out >= 0);
  for (size_t at = 0; at < bytes.size(); at += 1 << 16) {
    const size_t n = std::min(bytes.size() - at, size_t{1} << 16);
    REQUIRE(::write(out, bytes.data() + at, n) == static_cast<ssize_t>(n));
  }
  ::close(out);
}

// Reads `path` until the pipe is closed: an object that was opened before is the one it was, or an
// error; one that is opened now is one of the two. Leaves with 0, or with what went wrong.
int ReadWhileItChanges(const std::string& path, const std::array<SyntheticObject, 2>& objects,
                       int ready, int stop) {
  const auto database = Database::Open(path);
  if (!database.ok()) return 50;
  const auto source = (*database)->OpenObject("x");
  if (!source.ok() || !CompareObject(**source, objects[0]).ok()) return 51;
  int right = 0;
  char byte = 'r';
  if (::write(ready, &byte, 1) != 1) return 56;
  ::fcntl(stop, F_SETFL, O_NONBLOCK);
  while (::read(stop, &byte, 1) != 0) {
    const Status status = CompareObject(**source, objects[0]);
    if (status.code() == StatusCode::kInvalidArgument) return 52;
    if (status.ok()) ++right;
    const auto again = Database::Open(path);
    if (!again.ok()) continue;
    const auto now = (*again)->OpenObject("x");
    if (!now.ok()) continue;
    bool found = false;
    for (const SyntheticObject& object : objects) {
      const Status read = CompareObject(**now, object);
      found = found || read.code() != StatusCode::kInvalidArgument;
    }
    if (!found) return 53;
  }
  if (right == 0) return 54;
  return CompareObject(**source, objects[0]).ok() ? 0 : 55;  // what was there at first is back
}

TEST_CASE("a file that is written over or cut off while it is read is an error, never a signal",
          "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const std::string other = dir.File("other.mtdb");
  // A stranger, and a twin that only its payloads' bytes tell apart: all sizes and places are the
  // same.
  const bool twin = GENERATE(false, true);
  std::array objects{MakeObject({.seed = 1, .max_payload = 20000}),
                     MakeObject({.seed = twin ? 1u : 2u, .max_payload = 20000})};
  if (twin) {
    for (auto& unit : objects[1].units) unit.payload[0] ^= std::byte{1};
  }
  REQUIRE(WriteObject(*OpenWritable(path), "x", objects[0]).ok());
  REQUIRE(WriteObject(*OpenWritable(other), "x", objects[1]).ok());
  const std::array files{ReadFile(path), ReadFile(other)};
  int stop[2];
  int ready[2];
  REQUIRE(::pipe(stop) == 0);
  REQUIRE(::pipe(ready) == 0);
  const pid_t reader = ::fork();
  if (reader == 0) {
    ::close(stop[1]);
    ::_exit(ReadWhileItChanges(path, objects, ready[1], stop[0]));
  }
  ::close(stop[0]);
  char byte = 0;
  REQUIRE(::read(ready[0], &byte, 1) == 1);
  std::mt19937_64 random(5);
  const auto wait = [&] {
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 5000));
  };
  for (int round = 0; round < 40; ++round) {
    wait();
    CopyOver(files[1], path);
    wait();
    CopyOver(files[0], path);
    wait();
    REQUIRE(::truncate(path.c_str(), static_cast<off_t>(random() % files[0].size())) == 0);
    wait();
    CopyOver(files[0], path);
  }
  ::close(stop[1]);
  int status = 0;
  ::waitpid(reader, &status, 0);
  CHECK(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 0);
}

TEST_CASE("a writer whose file is cut off, written over or replaced says so and writes nothing",
          "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const std::string other = dir.File("other.mtdb");
  const SyntheticObject object = MakeObject({.seed = 1});
  REQUIRE(WriteObject(*OpenWritable(path), "x", object).ok());
  for (int i = 0; i < 3; ++i) {
    REQUIRE(WriteObject(*OpenWritable(other), "y" + std::to_string(i), object).ok());
  }
  const Bytes bytes = ReadFile(path);
  const Bytes others = ReadFile(other);
  const std::array<std::function<void()>, 5> harms{
      [&] { fs::resize_file(path, 0); }, [&] { fs::resize_file(path, bytes.size() / 2); },
      [&] { WriteFile(path, others); },  [&] { fs::rename(other, path); },
      [&] { fs::remove(path); },
  };
  for (size_t harm = 0; harm < harms.size(); ++harm) {
    INFO("harm " << harm);
    fs::remove(path);
    WriteFile(path, bytes);
    WriteFile(other, others);
    Bytes after;
    int result[2];
    REQUIRE(::pipe(result) == 0);
    const int status = RunChild([&] {
      const auto database = Database::Open(path, {.writable = true});
      if (!database.ok()) return 60;
      auto writer = (*database)->Create("z", false);
      if (!writer.ok()) return 61;
      harms[harm]();
      if (fs::exists(path)) after = ReadFile(path);
      if ((*database)->Remove("x").ok() || WriteObject(**database, "new", object).ok()) return 62;
      writer->reset();
      return !fs::exists(path) || ReadFile(path) == after ? 0 : 63;
    });
    CHECK(WIFEXITED(status));
    CHECK(WEXITSTATUS(status) == 0);
  }
}

// Each time that a snapshot was taken, `times` times in all, so many commits come that its pages
// are used again.
class Overtaker {
 public:
  Overtaker(Database& database, int times) : database_(database), left_(times) {
    TestPointHook() = [this](const char* point) {
      if (std::string("snapshot taken") != point || busy_ || left_ == 0) return;
      busy_ = true;
      --left_;
      ++count_;
      REQUIRE(WriteObject(database_, "passing", Passing(count_), true).ok());
      if (count_ % 2 == 0) REQUIRE(database_.Remove("passing").ok());
      busy_ = false;
    };
  }
  ~Overtaker() { TestPointHook() = nullptr; }
  int left() const { return left_; }

 private:
  Database& database_;
  int left_;
  uint64_t count_ = 0;
  bool busy_ = false;
};

TEST_CASE("a reader that writers overtake reads again, and gives up in the end", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  MakeStore(path);
  const auto database = OpenWritable(path);
  // So many objects that the catalog has several pages and is listed in parts.
  const SyntheticObject small = MakeObject({.seed = 9, .clusters = 1, .max_payload = 10});
  for (int i = 0; i < 80; ++i) {
    REQUIRE(WriteObject(*database, "many " + std::to_string(i), small).ok());
  }
  REQUIRE(WriteObject(*database, "passing", Passing(0)).ok());
  const auto kept = database->OpenObject("kept").value();
  const auto environment = Environment::Open(path, {}).value();
  {
    const Snapshot snapshot = environment->Newest(true).value();
    const auto nothing = [](WriteTransaction&) { return Status::Ok(); };
    CHECK(environment->Holds(snapshot).value());
    REQUIRE(environment->Write(nothing).ok());
    CHECK(environment->Holds(snapshot).value());
    REQUIRE(environment->Write(nothing).ok());
    CHECK_FALSE(environment->Holds(snapshot).value());
  }
  for (int round = 0; round < 2; ++round) {
    INFO("round " << round);
    {
      const Overtaker overtaker(*database, 3);
      const auto list = database->List();
      REQUIRE(list.status().message() == "");
      CHECK((list->size() == 81 || list->size() == 82));
      CHECK(std::ranges::is_sorted(*list, {}, &ObjectRecord::name));
      CHECK(overtaker.left() == 0);
    }
    {
      const Overtaker overtaker(*database, 3);
      CHECK(database->Find("kept").status().message() == "");
      CHECK(overtaker.left() == 0);
    }
    {
      const Overtaker overtaker(*database, 3);
      CHECK(database->Find("none").status().code() == StatusCode::kNotFound);
      CHECK(overtaker.left() == 0);
    }
    for (const int times : {1, 3, 6}) {
      const Overtaker overtaker(*database, times);
      const auto source = database->OpenObject("kept");
      REQUIRE(source.status().message() == "");
      CHECK(CompareObject(**source, Kept()).message() == "");
    }
    const Overtaker overtaker(*database, 1);
    CHECK(CompareObject(*kept, Kept()).message() == "");
    CHECK(overtaker.left() == 0);
  }
  TestPointHook() = [&](const char* point) {
    if (std::string("snapshot taken") != point) return;
    for (int i = 0; i < 2; ++i) {
      REQUIRE(environment->Write([](WriteTransaction&) { return Status::Ok(); }).ok());
    }
  };
  CHECK(database->Find("kept").status().code() == StatusCode::kBusy);
  TestPointHook() = nullptr;
  CHECK(VerifyFailures(path) == "");
}

TEST_CASE("a child does not use its parent's handles to write", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject object = MakeObject({.seed = 1});
  const auto database = OpenWritable(path);
  REQUIRE(WriteObject(*database, "x", object).ok());
  CHECK(RunChild([&] {
          if (WriteObject(*database, "y", object).ok()) return 1;
          if (!CompareObject(**database->OpenObject("x"), object).ok()) return 2;
          const auto own = Database::Open(path, {.writable = true});
          return own.ok() && WriteObject(**own, "z", object).ok() ? 0 : 3;
        }) == 0);
  CHECK(WriteObject(*database, "y", object).ok());
  CHECK(database->List()->size() == 3);
  CHECK(VerifyFailures(path) == "");
}

}  // namespace
}  // namespace mtdb::test
