// SPDX-License-Identifier: Apache-2.0
// Who gives way when what all share is used up: against a simple model.
#include "tools/server/internal/server_ledger.h"

#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

namespace mtdb::test {

using namespace internal;

namespace {

using Account = ServerLedger::Account;

ServerClient Client(int address) { return {"10.0.0." + std::to_string(address), 0}; }

TEST_CASE("what is held never exceeds the limit, and only who holds the most gives way",
          "[server]") {
  std::mt19937 random(4);
  for (int run = 0; run < 40; ++run) {
    const uint64_t limit = 1000;
    ServerLedger ledger(limit);
    struct Model {
      int address;
      uint64_t bytes;
      std::unique_ptr<Account> account;
    };
    std::vector<Model> all;
    for (int i = 0; i < 400; ++i) {
      if (all.size() < 12) {
        const int address = static_cast<int>(random() % 4);
        all.push_back({address, 0, std::make_unique<Account>(ledger, Client(address))});
      }
      const size_t asker = random() % all.size();
      if (random() % 10 == 0) {
        all.erase(all.begin() + static_cast<std::ptrdiff_t>(asker));
      } else if (!all[asker].account->evicted()) {
        const uint64_t wanted = random() % 500;
        std::map<int, uint64_t> before;
        for (const Model& m : all) before[m.address] += m.bytes;
        before[all[asker].address] += wanted - all[asker].bytes;
        const bool granted = all[asker].account->Set(wanted);
        uint64_t largest = 0;
        for (const auto& [address, bytes] : before) largest = std::max(largest, bytes);
        if (granted) {
          all[asker].bytes = wanted;
          // Who went was of an address that held no less than the asker's.
          for (Model& m : all) {
            if (!m.account->evicted() || m.bytes == 0) continue;
            CHECK(before[m.address] >= before[all[asker].address]);
            m.bytes = 0;
          }
        } else {
          CHECK(before[all[asker].address] + limit > largest);
          for (const Model& m : all) CHECK((!m.account->evicted() || m.bytes == 0));
        }
      }
      uint64_t sum = 0;
      for (const Model& m : all) sum += m.bytes;
      CHECK(ledger.bytes() == sum);
      CHECK(sum <= limit);
    }
    all.clear();
    CHECK(ledger.bytes() == 0);
  }
}

TEST_CASE("who asks for little gets it from who holds much", "[server]") {
  ServerLedger ledger(100);
  std::vector<std::unique_ptr<Account>> greedy;
  for (int i = 0; i < 4; ++i) {
    greedy.push_back(std::make_unique<Account>(ledger, Client(1)));
    CHECK(greedy.back()->Set(25));
  }
  // Of another address, and of the same.
  Account other(ledger, Client(2)), same(ledger, Client(1));
  CHECK(other.Set(10));
  CHECK(same.Set(10));
  CHECK(ledger.evictions() == 1);
  CHECK(ledger.bytes() == 95);
  // Who holds the most himself is refused, and nobody has to go for him.
  CHECK_FALSE(other.Set(101));
  Account late(ledger, Client(1));
  CHECK_FALSE(late.Set(30));
  CHECK(ledger.evictions() == 1);
  // What is given back is there for all.
  for (auto& account : greedy) CHECK(account->Set(0));
  CHECK(late.Set(80));
  CHECK_FALSE(late.evicted());
}

TEST_CASE("who was told to give way gets no more, and takes nothing with him", "[server]") {
  ServerLedger ledger(10);
  auto evicted = std::make_unique<Account>(ledger, Client(1));
  Account other(ledger, Client(2));
  CHECK(evicted->Set(9));
  CHECK(other.Set(4));
  CHECK(evicted->evicted());
  CHECK_FALSE(evicted->Set(1));
  evicted->Note(5);
  CHECK(ledger.bytes() == 4);
  evicted.reset();
  CHECK(ledger.bytes() == 4);
}

}  // namespace
}  // namespace mtdb::test
