// SPDX-License-Identifier: Apache-2.0
// Every byte of a small store may be wrong: a reader gives what was written or an error, and
// verify notices unless the byte carries nothing.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <random>

#include "store/lmdb/environment.h"
#include "store/pages/page_walker.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

struct SmallStore {
  SyntheticObject first = MakeObject({.seed = 1, .clusters = 700, .max_payload = 300});
  SyntheticObject second = MakeObject(
      {.seed = 2, .clusters = 30, .max_payload = 9000, .page_bytes = {0, 1, 1800, 9000, 270000}});
  Bytes bytes;
  std::vector<bool> covered;        // by the walker
  std::vector<uint64_t> structure;  // covered bytes outside of payloads and files
  std::vector<uint64_t> tree;       // covered bytes outside of all values
};

SmallStore MakeSmallStore(const std::string& path) {
  SmallStore store;
  {
    const auto database = OpenWritable(path);
    const SyntheticObject removed = MakeObject({.seed = 3, .clusters = 50});
    REQUIRE(WriteObject(*database, "first", store.first).status().message() == "");
    REQUIRE(WriteObject(*database, "between", removed).status().message() == "");
    REQUIRE(WriteObject(*database, "second", store.second).status().message() == "");
    REQUIRE(database->Remove("between").message() == "");
  }
  store.bytes = ReadFile(path);
  store.covered.assign(store.bytes.size(), false);
  const auto environment = Environment::Open(path, {});
  REQUIRE(environment.ok());
  const auto snapshot = (*environment)->NewestPinned();
  REQUIRE(snapshot.ok());
  WalkOptions options;
  options.covered = [&](uint64_t offset, uint64_t size) {
    REQUIRE(offset + size <= store.covered.size());
    std::fill_n(store.covered.begin() + static_cast<ptrdiff_t>(offset), size, true);
  };
  REQUIRE(WalkPages(snapshot->pages(), options).failures == std::vector<std::string>());
  std::vector<bool> payload(store.bytes.size(), false);
  std::vector<bool> value(store.bytes.size(), false);
  for (const Table table : {Table::kCatalog, Table::kUnits, Table::kIndex, Table::kTextures}) {
    const auto scanned =
        snapshot->Scan(table, {}, [&](ByteSpan, const ValueRef& v) -> Result<bool> {
          const auto at = static_cast<ptrdiff_t>(v.file_offset);
          std::fill_n(value.begin() + at, v.size, true);
          const bool is_bulk = table == Table::kUnits || table == Table::kTextures;
          if (is_bulk) std::fill_n(payload.begin() + at, v.size, true);
          return true;
        });
    REQUIRE(scanned.ok());
  }
  for (uint64_t i = 0; i < store.bytes.size(); ++i) {
    if (store.covered[i] && !payload[i]) store.structure.push_back(i);
    if (store.covered[i] && !value[i]) store.tree.push_back(i);
  }
  return store;
}

// Opens the file and reads all of it: true when an error was given, false when all was right.
bool ReadsWithError(const std::string& path, const SmallStore& store) {
  const auto database = Database::Open(path);
  if (!database.ok()) return true;
  bool error = !(*database)->List().ok();
  for (const auto& [name, object] :
       {std::pair{"first", &store.first}, std::pair{"second", &store.second}}) {
    const auto source = (*database)->OpenObject(name);
    if (!source.ok()) {
      error = true;
      continue;
    }
    const Status status = CompareObject(**source, *object);
    INFO(status.message());
    CHECK(status.code() != StatusCode::kInvalidArgument);  // another payload than was written
    error = error || !status.ok();
  }
  return error;
}

TEST_CASE("a flipped byte is never read as if it were right, and verify reports it", "[store]") {
  const TempDir dir;
  const SmallStore store = MakeSmallStore(dir.File("good.mtdb"));
  const std::string path = dir.File("flipped.mtdb");
  WriteFile(path, store.bytes);
  REQUIRE(!ReadsWithError(path, store));
  REQUIRE(VerifyFailures(path) == "");

  // The walker must claim all that was written: a mask of nothing would make this test hollow.
  uint64_t written = 0;
  for (const SyntheticObject* o : {&store.first, &store.second}) {
    for (const auto& u : o->units) written += u.payload.size() + 8;
    for (const Bytes& file : o->files) written += file.size();
  }
  const auto covered =
      static_cast<uint64_t>(std::count(store.covered.begin(), store.covered.end(), true));
  CHECK(covered > written + 30000);

  std::mt19937_64 random(2024);
  size_t reported = 0;
  for (int i = 0; i < 900; ++i) {
    const uint64_t at = i % 3 == 0   ? random() % store.bytes.size()
                        : i % 3 == 1 ? store.structure[random() % store.structure.size()]
                                     : store.tree[random() % store.tree.size()];
    Bytes flipped = store.bytes;
    const auto mask = static_cast<std::byte>(
        i % 2 == 0 ? 1u << random() % 8 : 1u + static_cast<unsigned>(random() % 255));
    flipped[at] ^= mask;
    WriteFile(path, flipped);
    INFO("byte " << at << " (page " << at / 4096 << ", offset " << at % 4096 << ") xor "
                 << static_cast<int>(mask));
    const bool error = ReadsWithError(path, store);
    const std::string failures = VerifyFailures(path);
    if (store.covered[at]) CHECK(failures != "");
    if (error) CHECK(failures != "");
    reported += failures != "" ? 1 : 0;
  }
  CHECK(reported > 700);
}

TEST_CASE("every byte of the live meta page is checked", "[store]") {
  const TempDir dir;
  const SmallStore store = MakeSmallStore(dir.File("good.mtdb"));
  const std::string path = dir.File("flipped.mtdb");
  const uint64_t live = store.covered[0] ? 0 : 4096;
  REQUIRE(store.covered[live]);
  for (uint64_t at = live; at < live + 152; ++at) {
    for (const int mask : {0x01, 0x80, 0xff}) {
      Bytes flipped = store.bytes;
      flipped[at] ^= static_cast<std::byte>(mask);
      WriteFile(path, flipped);
      INFO("byte " << at - live << " of the live meta page, xor " << mask);
      CHECK(VerifyFailures(path) != "");
      ReadsWithError(path, store);
    }
  }
}

TEST_CASE("a superseded meta page does not pass for the live one", "[store]") {
  const TempDir dir;
  const SmallStore store = MakeSmallStore(dir.File("good.mtdb"));
  const std::string path = dir.File("disguised.mtdb");
  const uint64_t live = store.covered[0] ? 0 : 4096;
  const uint64_t other = 4096 - live;
  const auto set = [](Bytes* bytes, uint64_t page, uint64_t txnid) {
    std::memcpy(bytes->data() + page + 144, &txnid, sizeof(txnid));
  };
  uint64_t txnid;
  std::memcpy(&txnid, store.bytes.data() + live + 144, sizeof(txnid));
  // The old one claims to be newer, then the new one to be older. Both look well-formed.
  Bytes raised = store.bytes;
  set(&raised, other, txnid + 1);
  Bytes lowered = store.bytes;
  set(&lowered, live, txnid - 2);
  for (const Bytes& bytes : {raised, lowered}) {
    WriteFile(path, bytes);
    const auto database = Database::Open(path);
    REQUIRE(!database.ok());
    CHECK(database.status().code() == StatusCode::kCorrupt);
    CHECK(database.status().message().find("superblock") != std::string::npos);
    CHECK(VerifyFailures(path) != "");
    CHECK(!Database::Open(path, {.writable = true}).ok());
  }
}

TEST_CASE("a writer refuses a store whose pages are damaged", "[store]") {
  const TempDir dir;
  const SmallStore store = MakeSmallStore(dir.File("good.mtdb"));
  const std::string path = dir.File("flipped.mtdb");
  std::mt19937_64 random(5);
  int refused = 0;
  for (int i = 0; i < 150; ++i) {
    const uint64_t at = store.tree[random() % store.tree.size()];
    Bytes flipped = store.bytes;
    flipped[at] ^= static_cast<std::byte>(1u << random() % 8);
    WriteFile(path, flipped);
    INFO("byte " << at << " (page " << at / 4096 << ", offset " << at % 4096 << ")");
    const auto database = Database::Open(path, {.writable = true});
    if (!database.ok()) {
      ++refused;
      continue;
    }
    // What is left are keys, separators and values: no structure that LMDB trusts.
    const auto removed = (*database)->Remove("second");
    const auto created = WriteObject(**database, "third", store.second);
    if (created.ok()) {
      const auto source = (*database)->OpenObject("third");
      REQUIRE(source.ok());
      CHECK(CompareObject(**source, store.second).message() == "");
    }
  }
  CHECK(refused > 75);
}

TEST_CASE("a check that is told to stop reads nothing more", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("a.mtdb");
  const SmallStore store = MakeSmallStore(path);
  // What is asked before each read: how often in all, and when it says stop at the n-th time.
  const auto asks = [&](uint64_t nth, CheckReport* report, Status* status) {
    uint64_t asked = 0;
    *status = VerifyStore(path, "", report, [&] { return ++asked == nth; });
    return asked;
  };
  CheckReport whole;
  Status status;
  const uint64_t all = asks(0, &whole, &status);
  REQUIRE(status.message() == "");
  CHECK(whole.failures == std::vector<std::string>());
  CHECK(all > 730);  // the payload of each cluster, and what leads there
  for (uint64_t nth = 1; nth <= all; nth += nth < 40 ? 1 : 31) {
    CheckReport report;
    INFO(nth << " of " << all);
    CHECK(asks(nth, &report, &status) == nth);
    CHECK(status.code() == StatusCode::kCancelled);
    CHECK(report.failures.empty());
  }
}

TEST_CASE("every truncation is refused at open or changes nothing", "[store]") {
  const TempDir dir;
  const SmallStore store = MakeSmallStore(dir.File("good.mtdb"));
  const std::string path = dir.File("short.mtdb");
  std::vector<uint64_t> sizes = {0,    1,    15,   16,   151,  152,  511,  512,
                                 1024, 4095, 4096, 4097, 8191, 8192, 8193, 12288};
  for (uint64_t size = 16384; size < store.bytes.size(); size += 4096) sizes.push_back(size);
  for (uint64_t size = 20000; size < store.bytes.size(); size += 7919) sizes.push_back(size);
  for (uint64_t back : {1, 100, 4095}) sizes.push_back(store.bytes.size() - back);
  size_t refused = 0;
  for (const uint64_t size : sizes) {
    INFO("size " << size << " of " << store.bytes.size());
    WriteFile(path, ByteSpan(store.bytes).first(size));
    const auto database = Database::Open(path);
    // The pages beyond the end may all be free ones.
    const bool all_free = std::none_of(store.covered.begin() + static_cast<ptrdiff_t>(size),
                                       store.covered.end(), [](bool b) { return b; });
    if (!database.ok()) {
      ++refused;
      CHECK(database.status().code() == StatusCode::kCorrupt);
      CHECK(database.status().message().find(path) == 0);
      CHECK(database.status().message().find('\n') == std::string::npos);
      CHECK(VerifyFailures(path) != "");
    } else {
      CHECK(all_free);
      CHECK(!ReadsWithError(path, store));
    }
  }
  CHECK(refused > sizes.size() / 2);
}

TEST_CASE("files that are no store are refused in one line", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("x.mtdb");
  CHECK(Database::Open(path).status().code() == StatusCode::kNotFound);
  CHECK(Database::Open(path, {.writable = true, .create = false}).status().code() ==
        StatusCode::kNotFound);
  CHECK(Database::Open(dir.File(""), {}).status().code() == StatusCode::kInvalidArgument);
  for (const size_t size : {0, 3, 5000, 100000}) {
    WriteFile(path, AsBytes(std::string(size, 't')));
    const auto database = Database::Open(path);
    REQUIRE(!database.ok());
    const StatusCode code = size < 1024 ? StatusCode::kCorrupt : StatusCode::kBadInput;
    CHECK(database.status().code() == code);
    CHECK(database.status().message().find('\n') == std::string::npos);
    if (size > 0) CHECK(!Database::Open(path, {.writable = true}).ok());
  }
}

TEST_CASE("a file that is no store is said to be what it seems to be", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("x.mtdb");
  const std::string rest(100000, '\0');
  for (const auto& [start, kind] :
       {std::pair("\x89PNG\r\n\x1a\n", "a PNG picture"), std::pair("%PDF-1.4", "a PDF document"),
        std::pair("SQLite format 3", "an SQLite database")}) {
    WriteFile(path, AsBytes(start + rest));
    const Status status = Database::Open(path).status();
    CHECK(status.code() == StatusCode::kBadInput);
    CHECK(status.message().find(kind) != std::string::npos);
    CheckReport report;
    CHECK(VerifyStore(path, "", &report).code() == StatusCode::kBadInput);
  }
}

TEST_CASE("a store whose first page was written over is damaged, and no other file", "[store]") {
  const TempDir dir;
  const std::string path = dir.File("x.mtdb");
  Bytes bytes = ReadFile(std::string(MTDB_SOURCE_DIR) + "/tests/golden/grid.mtdb");
  std::fill_n(bytes.begin(), 512, std::byte{'x'});
  WriteFile(path, bytes);
  CHECK(Database::Open(path).status().code() == StatusCode::kCorrupt);
  CHECK(VerifyFailures(path) != "");
}

}  // namespace
}  // namespace mtdb::test
