// SPDX-License-Identifier: Apache-2.0
#include "tools/server/internal/server_ledger.h"

#include <algorithm>
#include <vector>

namespace mtdb::internal {

ServerLedger::Account::Account(ServerLedger& ledger, const ServerClient& client)
    : ledger_(ledger), address_(client.address) {
  const std::lock_guard lock(ledger_.mutex_);
  ledger_.addresses_[address_];
  ledger_.accounts_.insert(this);
}

ServerLedger::Account::~Account() {
  const std::lock_guard lock(ledger_.mutex_);
  if (!evicted_) ledger_.Put(*this, 0);
  ledger_.accounts_.erase(this);
  const bool last = std::none_of(ledger_.accounts_.begin(), ledger_.accounts_.end(),
                                 [&](const Account* a) { return a->address_ == address_; });
  if (last) ledger_.addresses_.erase(address_);
}

bool ServerLedger::Account::Set(uint64_t bytes) {
  const std::lock_guard lock(ledger_.mutex_);
  if (evicted_) return bytes <= bytes_;
  if (bytes > bytes_ && !ledger_.MakeRoom(*this, bytes)) return false;
  ledger_.Put(*this, bytes);
  return true;
}

void ServerLedger::Account::Note(uint64_t bytes) {
  const std::lock_guard lock(ledger_.mutex_);
  if (!evicted_) ledger_.Put(*this, bytes);
}

void ServerLedger::Put(Account& account, uint64_t bytes) {
  bytes_ += bytes - account.bytes_;
  addresses_.at(account.address_) += bytes - account.bytes_;
  account.bytes_ = bytes;
}

// For `account` to hold so many bytes. Finds out who has to go before anybody does.
bool ServerLedger::MakeRoom(const Account& account, uint64_t bytes) {
  if (bytes > limit_) return false;
  std::map<std::string, uint64_t> held = addresses_;
  held.at(account.address_) += bytes - account.bytes_;
  uint64_t sum = bytes_ + bytes - account.bytes_;
  std::set<Account*> left = accounts_;
  std::vector<Account*> leaving;
  while (sum > limit_) {
    Account* most = nullptr;
    const auto size = [&](const Account* a) { return a == &account ? bytes : a->bytes_; };
    for (Account* a : left) {
      if (size(a) == 0) continue;
      const uint64_t mine = held.at(a->address_);
      const uint64_t best = most == nullptr ? 0 : held.at(most->address_);
      // Among equals it is the one who asks.
      if (most == nullptr || mine > best ||
          (mine == best && (size(a) > size(most) || (size(a) == size(most) && a == &account)))) {
        most = a;
      }
    }
    if (most == nullptr || most == &account) return false;
    held.at(most->address_) -= most->bytes_;
    sum -= most->bytes_;
    left.erase(most);
    leaving.push_back(most);
  }
  for (Account* a : leaving) {
    Put(*a, 0);
    accounts_.erase(a);
    a->evicted_ = true;
    ++evictions_;
  }
  return true;
}

uint64_t ServerLedger::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

uint64_t ServerLedger::evictions() const {
  const std::lock_guard lock(mutex_);
  return evictions_;
}

}  // namespace mtdb::internal
