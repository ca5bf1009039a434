// SPDX-License-Identifier: Apache-2.0
// The sender's table of keys against std::map, under random use.
#include "codecs/stream/encode/key_table.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdint>
#include <map>
#include <random>
#include <utility>
#include <vector>

namespace mtdb::internal {
namespace {

TEST_CASE("a table of keys finds what a map finds, whatever was put and erased") {
  for (const bool sequential : {false, true}) {
    std::mt19937_64 random(7);
    KeyTable table;
    std::map<uint64_t, uint32_t> model;  // slots by key
    std::vector<uint32_t> free;
    uint32_t slots = 0;
    uint64_t next = 0;
    CHECK(table.Find(0) == kNone32);
    for (int step = 0; step < 40000; ++step) {
      // It grows, shrinks to nothing, and grows again.
      const bool put = random() % 8 < (step / 10000 % 2 == 0 ? 6u : 2u);
      if (put || model.empty()) {
        const uint64_t key = sequential ? next++ : random() % 100000;
        if (model.contains(key)) continue;
        uint32_t slot = slots;
        if (free.empty()) {
          ++slots;
        } else {
          slot = free.back();
          free.pop_back();
        }
        table.Put(key, slot);
        model[key] = slot;
      } else {
        auto at = model.lower_bound(random() % 100000);
        if (at == model.end()) at = model.begin();
        CHECK(table.key(at->second) == at->first);
        table.Erase(at->second);
        free.push_back(at->second);
        model.erase(at);
      }
      const uint64_t key = sequential ? random() % (next + 1) : random() % 100000;
      const auto found = model.find(key);
      CHECK(table.Find(key) == (found == model.end() ? kNone32 : found->second));
      if (step % 1000 != 0) continue;
      std::vector<uint32_t> expected;
      for (const auto& [k, slot] : model) {
        CHECK(table.Find(k) == slot);
        expected.push_back(slot);
      }
      std::sort(expected.begin(), expected.end());
      CHECK(table.Slots() == expected);
    }
  }
}

TEST_CASE("a table of keys that come and go in runs takes no more memory with time") {
  KeyTable table;
  size_t memory = 0;
  for (uint64_t round = 0; round < 1000; ++round) {
    for (uint32_t slot = 0; slot < 700; ++slot) table.Put(round << 32 | (3 + slot), slot);
    for (uint32_t slot = 0; slot < 700; ++slot) {
      REQUIRE(table.Find(round << 32 | (3 + slot)) == slot);
      REQUIRE(table.key(slot) == (round << 32 | (3 + slot)));
    }
    for (uint32_t slot = 0; slot < 700; ++slot) table.Erase(slot);
    REQUIRE(table.Find(round << 32 | 3) == kNone32);
    REQUIRE(table.Slots().empty());
    if (round == 1) memory = table.memory_bytes();
  }
  CHECK(table.memory_bytes() == memory);
}

}  // namespace
}  // namespace mtdb::internal
