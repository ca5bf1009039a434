// SPDX-License-Identifier: Apache-2.0
// NamedLocks: one thread at a time for each name, and nobody waits for other names.
#pragma once

#include <condition_variable>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "store/base/status.h"
#include "store/base/wait_scope.h"

namespace mtdb::internal {

// Safe for many threads.
class NamedLocks {
 public:
  class Held {
   public:
    Held(NamedLocks* locks, std::string name) : locks_(locks), name_(std::move(name)) {}
    Held(Held&& other) noexcept
        : locks_(std::exchange(other.locks_, nullptr)), name_(std::move(other.name_)) {}
    Held& operator=(Held&&) = delete;
    ~Held() {
      if (locks_ == nullptr) return;
      const std::lock_guard lock(locks_->mutex_);
      locks_->taken_.erase(name_);
      locks_->given_back_.notify_all();
    }

   private:
    NamedLocks* locks_;
    std::string name_;
  };

  // Waits for the name. kCancelled: the thread's WaitScope has stopped before.
  Result<Held> Take(const std::string& name) {
    std::string own = name;  // before it is taken: memory may run out
    std::unique_lock lock(mutex_);
    const auto take = [&] { return taken_.insert(name).second; };
    if (!WaitScope::Wait(given_back_, lock, take)) {
      return Status(StatusCode::kCancelled, "cancelled");
    }
    return Held(this, std::move(own));
  }

 private:
  std::mutex mutex_;
  std::condition_variable given_back_;
  std::set<std::string> taken_;
};

}  // namespace mtdb::internal
