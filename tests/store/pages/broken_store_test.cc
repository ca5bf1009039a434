// SPDX-License-Identifier: Apache-2.0
// Stores that must be refused, each with the reason: made from the golden one, with checksums that
// are right again, as a newer program or an enemy would write them.
#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <functional>
#include <initializer_list>
#include <thread>
#include <vector>

#include "store/pages/catalog_entry.h"
#include "store/records/keys.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

// A store file whose values can be changed in place.
class Patient {
 public:
  Patient()
      : bytes_(ReadFile(std::string(MTDB_SOURCE_DIR) + "/tests/golden/grid.mtdb")),
        path_(dir_.File("broken.mtdb")) {}

  Bytes& bytes() { return bytes_; }
  const std::string& path() const { return path_; }

  template <typename T>
  void Put(size_t at, T value) {
    REQUIRE(at + sizeof(T) <= bytes_.size());
    std::memcpy(bytes_.data() + at, &value, sizeof(T));
  }
  template <typename T>
  T Get(size_t at) const {
    T value;
    std::memcpy(&value, bytes_.data() + at, sizeof(T));
    return value;
  }

  // The page of a snapshot's live meta page.
  size_t LiveMeta() const {
    constexpr size_t kTransactionId = 144;
    return Get<uint64_t>(kTransactionId) > Get<uint64_t>(4096 + kTransactionId) ? 0 : 4096;
  }

  // Changes bodies of catalog entries under `key` that begin so, in all snapshots, and seals them.
  void Change(ByteSpan key, ByteSpan begin, size_t size_bytes,
              const std::function<void(std::byte* body)>& change) {
    const uint64_t seed = ValueSeed(Table::kCatalog, key);
    size_t changed = 0;
    for (size_t at = kChecksumBytes; at + size_bytes <= bytes_.size(); ++at) {
      const ByteSpan body = ByteSpan(bytes_).subspan(at, size_bytes);
      if (!std::ranges::equal(begin, body.first(begin.size()))) continue;
      if (Hash64(body, seed) != Get<uint64_t>(at - kChecksumBytes)) continue;
      change(bytes_.data() + at);
      Put(at - kChecksumBytes, Hash64(body, seed));
      ++changed;
    }
    REQUIRE(changed > 0);
  }
  void ChangeSuperblock(const std::function<void(std::byte* body)>& change) {
    Change(SuperblockKey(), AsBytes("mtdb store"), kSuperblockBytes, change);
  }
  // From its version on.
  void ChangeRecord(const std::function<void(std::byte* body)>& change) {
    WriteFile(path_, bytes_);
    const Bytes body = EncodeObjectRecord(OpenReadOnly(path_)->Find("sheet").value());
    Change(ObjectKey("sheet"), body, body.size(), change);
  }

  // Every way in says so.
  void RequireRefused(StatusCode code, std::initializer_list<const char*> words) {
    WriteFile(path_, bytes_);
    const std::string failures = VerifyFailures(path_);
    const auto database = Database::Open(path_);
    const Status opened =
        database.ok() ? (*database)->OpenObject("sheet").status() : database.status();
    INFO(opened.message() << "\n" << failures);
    REQUIRE(opened.code() == code);
    CHECK(opened.message().starts_with(path_));
    CHECK(opened.message().find('\n') == std::string::npos);
    for (const char* word : words) {
      INFO(word);
      CHECK(opened.message().find(word) != std::string::npos);
      CHECK(failures.find(word) != std::string::npos);
    }
  }

 private:
  const TempDir dir_;
  Bytes bytes_;
  std::string path_;
};

TEST_CASE("the golden store is sound", "[store]") {
  Patient store;
  WriteFile(store.path(), store.bytes());
  CHECK(VerifyFailures(store.path()) == "");
  CHECK(OpenReadOnly(store.path())->OpenObject("sheet").ok());
}

TEST_CASE("a file of another program is refused", "[store]") {
  Patient store;
  store.ChangeSuperblock([](std::byte* body) { body[0] = std::byte{'x'}; });
  store.RequireRefused(StatusCode::kUnsupported, {"not an mtdb store"});
}

TEST_CASE("a store of a future version is refused, with both versions", "[store]") {
  Patient store;
  const auto version = static_cast<uint8_t>(kStoreVersion + 1);
  store.ChangeSuperblock([&](std::byte* body) { body[16] = std::byte{version}; });
  const std::string theirs = "store version " + std::to_string(version);
  const std::string ours = "reads version " + std::to_string(kStoreVersion);
  store.RequireRefused(StatusCode::kUnsupported, {theirs.c_str(), ours.c_str(), "newer program"});
}

TEST_CASE("a store with a flag that must be understood is refused", "[store]") {
  Patient store;
  store.ChangeSuperblock([](std::byte* body) { body[21] = std::byte{4}; });
  store.RequireRefused(StatusCode::kUnsupported, {"store flags 1024", "newer program"});
}

TEST_CASE("an object record of a future version is refused", "[store]") {
  Patient store;
  store.ChangeRecord([](std::byte* body) { body[0] = std::byte{9}; });
  store.RequireRefused(StatusCode::kUnsupported, {"sheet", "version 9"});
}

TEST_CASE("an object record with a section that must be understood is refused", "[store]") {
  Patient store;
  store.ChangeRecord([](std::byte* body) { body[6] = std::byte{0xf1}; });
  store.RequireRefused(StatusCode::kUnsupported, {"sheet", "241"});
}

TEST_CASE("a wrong checksum names the value", "[store]") {
  Patient store;
  // Of the object's name, in every snapshot.
  const auto name = AsBytes("\5sheet");
  auto at = store.bytes().begin();
  while ((at = std::search(at, store.bytes().end(), name.begin(), name.end())) !=
         store.bytes().end()) {
    *++at = std::byte{'t'};
  }
  store.RequireRefused(StatusCode::kCorrupt, {"object sheet", "checksum"});
}

TEST_CASE("a truncated store is refused", "[store]") {
  Patient store;
  store.bytes().resize(store.bytes().size() / 2);
  store.RequireRefused(StatusCode::kCorrupt, {"truncated"});
}

TEST_CASE("a damaged record does not keep other objects from being read and written", "[store]") {
  Patient store;
  store.ChangeRecord([](std::byte* body) { body[0] = std::byte{9}; });
  WriteFile(store.path(), store.bytes());
  const auto database = OpenWritable(store.path());
  const SyntheticObject object = MakeObject({.seed = 1});
  REQUIRE(WriteObject(*database, "other", object).status().message() == "");
  CHECK(CompareObject(**database->OpenObject("other"), object).message() == "");
  CHECK(database->OpenObject("sheet").status().code() == StatusCode::kUnsupported);
  CHECK(database->Remove("other").message() == "");
}

TEST_CASE("nobody gets a handle of a store that cannot be opened", "[store][threads]") {
  Patient store;
  store.bytes().resize(store.bytes().size() / 2);
  WriteFile(store.path(), store.bytes());
  for (int round = 0; round < 30; ++round) {
    std::vector<Status> found(6);
    std::vector<std::thread> threads;
    for (size_t t = 0; t < found.size(); ++t) {
      threads.emplace_back([&, t] {
        const auto database = Database::Open(store.path(), {.writable = t % 2 == 1});
        found[t] = database.status();
      });
    }
    for (std::thread& thread : threads) thread.join();
    for (const Status& status : found) CHECK(status.code() == StatusCode::kCorrupt);
  }
}

// A root page that is a branch to itself.
TEST_CASE("a tree that loops is refused and ends", "[store]") {
  constexpr size_t kMainDepth = 16 + 24 + 48 + 6;
  constexpr size_t kMainRoot = 16 + 24 + 48 + 40;
  for (const uint16_t depth : {1, 2, 30, 32}) {
    Patient store;
    const size_t meta = store.LiveMeta();
    store.Put<uint16_t>(meta + kMainDepth, depth);
    const auto root = store.Get<uint64_t>(meta + kMainRoot);
    const size_t page = root * 4096;
    // Two nodes of 8 and 10 bytes, the second with a key of one byte.
    store.Put<uint16_t>(page + 10, 1);
    store.Put<uint16_t>(page + 12, 20);
    store.Put<uint16_t>(page + 14, 4096 - 18);
    store.Put<uint16_t>(page + 16, 4096 - 18);
    store.Put<uint16_t>(page + 18, 4096 - 10);
    for (const size_t node : {page + 4096 - 18, page + 4096 - 10}) {
      store.Put<uint32_t>(node, static_cast<uint32_t>(root));
      store.Put<uint16_t>(node + 4, 0);
      store.Put<uint16_t>(node + 6, node == page + 4096 - 18 ? 0 : 1);
    }
    store.Put<uint16_t>(page + 4096 - 2, 'm');
    store.RequireRefused(StatusCode::kCorrupt, {"page"});
  }
}

}  // namespace
}  // namespace mtdb::test
