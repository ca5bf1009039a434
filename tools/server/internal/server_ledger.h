// SPDX-License-Identifier: Apache-2.0
// ServerLedger: who holds how many bytes of something that all clients share, and who gives way
// when it is used up.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <set>
#include <string>

#include "tools/server/internal/fair_queue.h"

namespace mtdb::internal {

// At the limit whoever holds the most gives way: of the address that holds the most, the account
// that does. So who asks for little gets it as long as others hold much. Safe for many threads.
// Cost of a decision: in proportion to the accounts.
class ServerLedger {
 public:
  class Account {
   public:
    Account(ServerLedger& ledger, const ServerClient& client);
    ~Account();
    Account(const Account&) = delete;
    Account& operator=(const Account&) = delete;

    // Sets what it holds. Less is always granted. False, and nothing changes, when there is no
    // room: nobody holds more who could give way.
    [[nodiscard]] bool Set(uint64_t bytes);
    // Likewise, of what is held already: without asking.
    void Note(uint64_t bytes);
    // It has to give way: its owner lets go of what it holds, and of the account. Its bytes are
    // granted to others already.
    bool evicted() const { return evicted_; }

   private:
    friend class ServerLedger;
    ServerLedger& ledger_;
    const std::string address_;
    uint64_t bytes_ = 0;
    std::atomic<bool> evicted_{false};
  };

  explicit ServerLedger(uint64_t limit_bytes) : limit_(limit_bytes) {}

  uint64_t limit() const { return limit_; }
  // What is held; by those who were told to give way, no more.
  uint64_t bytes() const;
  uint64_t evictions() const;

 private:
  bool MakeRoom(const Account& account, uint64_t bytes);
  void Put(Account& account, uint64_t bytes);

  const uint64_t limit_;
  mutable std::mutex mutex_;
  std::set<Account*> accounts_;  // not evicted
  std::map<std::string, uint64_t> addresses_;
  uint64_t bytes_ = 0;
  uint64_t evictions_ = 0;
};

}  // namespace mtdb::internal
