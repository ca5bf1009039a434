// SPDX-License-Identifier: Apache-2.0
// A lack of memory at every allocation of what a store does: an error, nothing lost, no lock held.
#include <catch2/catch.hpp>

#include "tests/store/store_fixture.h"
#include "tests/support/failing_allocation.h"

namespace mtdb::test {
namespace {

using mtdb::testing::FailEachAllocation;
using Mode = mtdb::testing::FailingAllocation::Mode;

void CheckError(const Status& status, bool last, uint64_t n) {
  INFO("allocation " << n << ": " << status.message());
  CHECK((last ? status.ok() : status.ok() || status.code() == StatusCode::kNoSpace));
}

// Opens a store and reads it, as long as nothing fails.
Status OpenAndRead(const std::string& path, const std::string& name) {
  MTDB_ASSIGN_OR_RETURN(const auto database, Database::Open(path));
  MTDB_ASSIGN_OR_RETURN(const auto all, database->List());
  MTDB_ASSIGN_OR_RETURN(const auto source, database->OpenObject(name));
  return all.size() == 2 ? Status::Ok() : Corrupt("objects");
}

Status OpenAndWrite(const std::string& path, const std::string& name,
                    const SyntheticObject& object) {
  MTDB_ASSIGN_OR_RETURN(const auto database,
                        Database::Open(path, {.writable = true, .create = true}));
  MTDB_RETURN_IF_ERROR(WriteObject(*database, name, object, true).status());
  return database->Remove(name);
}

TEST_CASE("memory that runs out while a store is opened and read is an error", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SyntheticObject object = MakeObject({.seed = 1});
  REQUIRE(WriteObject(*OpenWritable(path), "a", object).ok());
  REQUIRE(WriteObject(*OpenWritable(path), "b", object).ok());
  const std::string name = "a";
  for (const Mode mode : {Mode::kOnce, Mode::kFromThenOn}) {
    for (const bool beside : {false, true}) {
      const auto other = beside ? OpenReadOnly(path) : nullptr;
      Status last = Status::Ok();
      const uint64_t end = FailEachAllocation(
          mode, [&] { return OpenAndRead(path, name); },
          [&](uint64_t n, const Status& status) {
            CheckError(status, false, n);
            CHECK(OpenAndRead(path, name).message() == "");
            last = status;
          });
      CheckError(last, true, end);
      CHECK(end > 20);
    }
  }
}

TEST_CASE("memory that runs out while a store is written leaves it whole, and free for others",
          "[store]") {
  const SyntheticObject object = MakeObject({.seed = 2, .clusters = 12, .max_payload = 300});
  const std::string name = "fresh";
  for (const Mode mode : {Mode::kOnce, Mode::kFromThenOn}) {
    for (const bool there : {false, true}) {
      const TempDir dir;
      const std::string path = dir.File("a.mtdb");
      if (there) REQUIRE(WriteObject(*OpenWritable(path), "kept", object).ok());
      Status last = Status::Ok();
      const uint64_t end = FailEachAllocation(
          mode, [&] { return OpenAndWrite(path, name, object); },
          [&](uint64_t n, const Status& status) {
            CheckError(status, false, n);
            last = status;
            // Another process is not kept waiting.
            if (n % 16 != 0) return;
            CHECK(RunChild([&] { return OpenAndWrite(path, name, object).ok() ? 0 : 1; }) == 0);
            CHECK(VerifyFailures(path) == "");
            CHECK(OpenReadOnly(path)->List()->size() == (there ? 1 : 0));
          });
      CheckError(last, true, end);
      CHECK(end > 50);
      CHECK(OpenAndWrite(path, name, object).message() == "");
      CHECK(VerifyFailures(path) == "");
    }
  }
}

}  // namespace
}  // namespace mtdb::test
