// SPDX-License-Identifier: Apache-2.0
// The page reader against two oracles: LMDB's own cursor and a std::map.
#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <random>
#include <thread>

#include "store/lmdb/environment.h"
#include "store/pages/page_reader.h"
#include "store/pages/page_walker.h"
#include "tests/store/store_fixture.h"

namespace mtdb::test {

using namespace internal;

namespace {

using Model = std::map<std::string, std::string>;

std::string RandomText(std::mt19937_64& random, size_t size) {
  std::string s(size, ' ');
  for (char& c : s) c = static_cast<char>(random());
  return s;
}

class Workload {
 public:
  Workload(uint64_t seed, size_t max_key, size_t max_value)
      : random_(seed), max_key_(max_key), max_value_(max_value) {}

  // A transaction of `changes` puts and deletes, in the store and in the model.
  void Change(Environment& environment, size_t changes, unsigned deletes_of_ten) {
    std::vector<std::pair<std::string, std::optional<std::string>>> todo;
    for (size_t i = 0; i < changes; ++i) {
      if (random_() % 10 < deletes_of_ten && !model_.empty()) {
        auto it = model_.lower_bound(RandomText(random_, 2));
        if (it == model_.end()) it = model_.begin();
        // Runs of neighbours, so that pages merge.
        for (int run = 0; run < 20 && it != model_.end(); ++run) {
          todo.emplace_back(it->first, std::nullopt);
          it = model_.erase(it);
        }
      } else {
        const std::string key = RandomText(random_, 1 + random_() % max_key_);
        const std::string value = RandomText(random_, random_() % (max_value_ + 1));
        todo.emplace_back(key, value);
        model_[key] = value;
      }
    }
    const Status status = environment.Write([&](WriteTransaction& write) -> Status {
      for (const auto& [key, value] : todo) {
        MTDB_RETURN_IF_ERROR(value ? write.Put(Table::kUnits, AsBytes(key), AsBytes(*value))
                                   : write.Delete(Table::kUnits, AsBytes(key)));
      }
      return Status::Ok();
    });
    REQUIRE(status.message() == "");
  }

  const Model& model() const { return model_; }
  std::mt19937_64& random() { return random_; }

 private:
  std::mt19937_64 random_;
  size_t max_key_;
  size_t max_value_;
  Model model_;
};

Model ReadAll(const Snapshot& snapshot, ByteSpan first = {}) {
  Model read;
  std::string last;
  bool ascending = true;
  const Status status =
      snapshot.Scan(Table::kUnits, first, [&](ByteSpan key, const ValueRef& value) -> Result<bool> {
        MTDB_ASSIGN_OR_RETURN(const Bytes bytes, snapshot.pages().ReadWhole(value, 1 << 30));
        const std::string k(AsString(key));
        ascending = ascending && (read.empty() || last < k);
        last = k;
        read[k] = std::string(AsString(bytes));
        return true;
      });
  CHECK(status.message() == "");
  CHECK(ascending);
  return read;
}

Model ReadByLmdb(Environment& environment) {
  Model read;
  const Status status = environment.Write([&](WriteTransaction& write) -> Status {
    read.clear();
    return write.Scan(Table::kUnits, {}, [&](ByteSpan key, ByteSpan value) -> Result<bool> {
      read[std::string(AsString(key))] = std::string(AsString(value));
      return true;
    });
  });
  CHECK(status.message() == "");
  return read;
}

TEST_CASE("the page reader finds what LMDB's cursor finds", "[store]") {
  const auto [max_key, max_value] =
      GENERATE(std::pair<size_t, size_t>{20, 100}, std::pair<size_t, size_t>{510, 3000},
               std::pair<size_t, size_t>{3, 70000});
  const TempDir dir;
  const auto environment = Environment::Open(dir.File("a.mtdb"), {.writable = true});
  REQUIRE(environment.status().message() == "");
  Workload work(max_key * 31 + max_value, max_key, max_value);
  for (int step = 0; step < 24; ++step) {
    work.Change(**environment, max_value > 10000 ? 12 : 150, step % 4 == 3 ? 9u : 2u);
    const auto snapshot = (*environment)->NewestPinned();
    REQUIRE(snapshot.status().message() == "");
    REQUIRE(ReadAll(*snapshot) == work.model());
    const WalkReport walk = WalkPages(snapshot->pages(), {});
    REQUIRE(walk.failures == std::vector<std::string>());
    for (int i = 0; i < 200; ++i) {
      std::string key = RandomText(work.random(), 1 + work.random()() % max_key);
      const auto at = work.model().lower_bound(key);
      if (i % 2 == 0 && at != work.model().end()) key = at->first;
      const auto found = snapshot->Find(Table::kUnits, AsBytes(key));
      REQUIRE(found.status().message() == "");
      const auto expected = work.model().find(key);
      REQUIRE(found->has_value() == (expected != work.model().end()));
      if (!found->has_value()) continue;
      const auto value = snapshot->pages().ReadWhole(**found, 1 << 20);
      REQUIRE(value.status().message() == "");
      REQUIRE(AsString(*value) == expected->second);
    }
    const std::string from = RandomText(work.random(), 2);
    CHECK(ReadAll(*snapshot, AsBytes(from)) ==
          Model(work.model().lower_bound(from), work.model().end()));
  }
  CHECK(ReadByLmdb(**environment) == work.model());
}

TEST_CASE("a pinned snapshot stays as it was while a writer commits", "[store]") {
  const TempDir dir;
  const auto environment = Environment::Open(dir.File("a.mtdb"), {.writable = true});
  REQUIRE(environment.ok());
  Workload work(7, 30, 5000);
  work.Change(**environment, 300, 0);
  const Model before = work.model();
  const auto snapshot = (*environment)->NewestPinned();
  REQUIRE(snapshot.ok());
  std::thread writer([&] {
    for (int i = 0; i < 30; ++i) work.Change(**environment, 40, 5);
  });
  writer.join();
  CHECK(ReadAll(*snapshot) == before);
  CHECK(before != work.model());
}

TEST_CASE("emptied tables keep their pages accounted for", "[store]") {
  const TempDir dir;
  const auto environment = Environment::Open(dir.File("a.mtdb"), {.writable = true});
  REQUIRE(environment.ok());
  Workload work(9, 40, 9000);
  work.Change(**environment, 400, 0);
  bool done = false;
  while (!done) {
    const Status status = (*environment)->Write([&](WriteTransaction& write) -> Status {
      MTDB_ASSIGN_OR_RETURN(done, write.DeletePrefix(Table::kUnits, {}, 37, 1 << 20));
      return Status::Ok();
    });
    REQUIRE(status.message() == "");
    const auto snapshot = (*environment)->NewestPinned();
    REQUIRE(snapshot.ok());
    CHECK(WalkPages(snapshot->pages(), {}).failures == std::vector<std::string>());
  }
  const auto snapshot = (*environment)->NewestPinned();
  REQUIRE(snapshot.ok());
  CHECK(ReadAll(*snapshot) == Model());
  CHECK(snapshot->pages().meta().main_tree.entries == 1);  // the superblock
}

}  // namespace
}  // namespace mtdb::test
