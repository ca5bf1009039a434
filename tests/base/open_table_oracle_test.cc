// SPDX-License-Identifier: Apache-2.0
// OpenTable against std::unordered_map.
#include <algorithm>
#include <catch2/catch.hpp>
#include <random>
#include <unordered_map>
#include <utility>
#include <vector>

#include "store/base/open_table.h"

namespace mtdb::internal {
namespace {

struct Entry {
  uint32_t key = kNone32, value = 0;
  bool empty() const { return key == kNone32; }
};

// Few homes, so that runs are long and go around the end of the table.
uint64_t Crowded(uint32_t key) { return HashOfNumber(key % 7) | uint64_t{key} << 8; }
uint64_t Equal(uint32_t) { return ~uint64_t{0}; }
uint64_t Spread(uint32_t key) { return HashOfNumber(key); }

class Walk {
 public:
  Walk(uint64_t (*hash)(uint32_t), uint32_t seed) : hash_(hash), random_(seed) {
    table_.Reset(1 + random_() % 5);
  }

  void Run(int steps, uint32_t keys) {
    for (int step = 0; step < steps; ++step) {
      const auto key = static_cast<uint32_t>(random_() % keys);
      if (random_() % 5 < 3) {
        Put(key);
      } else {
        Erase(key);
      }
      Compare(static_cast<uint32_t>(random_() % keys));
    }
    CompareAll();
  }

 private:
  uint64_t HashOf(const Entry& entry) const { return hash_(entry.key); }
  Entry& Find(uint32_t key) {
    return table_.Find(hash_(key), [key](const Entry& entry) { return entry.key == key; });
  }
  void Put(uint32_t key) {
    const auto value = static_cast<uint32_t>(random_());
    Entry& entry = Find(key);
    if (entry.empty() && known_.size() + 2 > table_.size()) {
      table_.Resize(table_.size() + 1, [this](const Entry& e) { return HashOf(e); });
      REQUIRE(Find(key).empty());
      table_.FindEmpty(hash_(key)) = {key, value};
    } else {
      entry = {key, value};
    }
    known_[key] = value;
  }
  void Erase(uint32_t key) {
    Entry& entry = Find(key);
    REQUIRE(entry.empty() == !known_.contains(key));
    if (entry.empty()) return;
    table_.Erase(entry, [this](const Entry& e) { return HashOf(e); });
    known_.erase(key);
  }
  void Compare(uint32_t key) {
    const Entry& entry =
        std::as_const(table_).Find(hash_(key), [key](const Entry& e) { return e.key == key; });
    const auto known = known_.find(key);
    REQUIRE(entry.empty() == (known == known_.end()));
    if (!entry.empty()) REQUIRE(entry.value == known->second);
  }
  void CompareAll() {
    std::unordered_map<uint32_t, uint32_t> held;
    table_.ForEach([&](const Entry& entry) {
      REQUIRE(held.emplace(entry.key, entry.value).second);
      Compare(entry.key);
    });
    CHECK(held == known_);
    CHECK(table_.memory_bytes() >= table_.size() * sizeof(Entry));
  }

  uint64_t (*const hash_)(uint32_t);
  std::mt19937 random_;
  OpenTable<Entry> table_;
  std::unordered_map<uint32_t, uint32_t> known_;
};

TEST_CASE("A table holds what a map holds, however full it is and however its hashes crowd") {
  for (uint32_t seed = 0; seed < 40; ++seed) {
    CAPTURE(seed);
    Walk(Spread, seed).Run(400, 30 + seed);
    Walk(Crowded, seed).Run(400, 30 + seed);
    Walk(Equal, seed).Run(200, 12);
  }
  Walk(Spread, 1).Run(20000, 5000);
}

TEST_CASE("A table of places, or of pointers, is empty where there is none") {
  const std::vector<uint32_t> things{7, 0, kNone32 - 1, 12};
  OpenTable<uint32_t> places;
  OpenTable<const uint32_t*> pointers;
  CHECK(places.size() == 0);
  places.Reset(5);
  pointers.Reset(8);
  CHECK(places.size() == 8);
  for (uint32_t i = 0; i < things.size(); ++i) {
    places.FindEmpty(HashOfNumber(things[i])) = i;
    pointers.FindEmpty(HashOfNumber(things[i])) = &things[i];
  }
  for (uint32_t i = 0; i < things.size(); ++i) {
    const uint64_t hash = HashOfNumber(things[i]);
    CHECK(places.Find(hash, [&](uint32_t p) { return things[p] == things[i]; }) == i);
    CHECK(pointers.Find(hash, [&](const uint32_t* p) { return *p == things[i]; }) == &things[i]);
  }
  const auto five = [&](uint32_t p) { return things[p] == 5; };
  CHECK(OpenTable<uint32_t>::Empty(places.Find(HashOfNumber(5), five)));
  places.Reset(3);
  CHECK(places.size() == 4);
  places.ForEach([](uint32_t) { FAIL("a table that was reset holds something"); });
  places.Release();
  CHECK(places.memory_bytes() == 0);
}

}  // namespace
}  // namespace mtdb::internal
