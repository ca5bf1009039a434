// SPDX-License-Identifier: Apache-2.0
// WaitScope: what a thread waits for from far away can be given up.
#pragma once

#include <chrono>
#include <functional>
#include <utility>

#include "store/base/threading.h"

namespace mtdb {

// While it lives, waits of this thread for bytes of files behind URLs end with kCancelled soon
// after `stopped` has returned true, which is asked some times a second on this thread. Scopes may
// be nested; the inner one decides. Not for other threads that this one starts.
class WaitScope {
 public:
  explicit WaitScope(std::function<bool()> stopped)
      : stopped_(std::move(stopped)), outer_(std::exchange(current_, this)) {}
  ~WaitScope() { current_ = outer_; }
  WaitScope(const WaitScope&) = delete;
  WaitScope& operator=(const WaitScope&) = delete;

  // Of the thread that asks.
  static bool IsStopped() { return current_ != nullptr && current_->stopped_(); }

#if MTDB_THREADS
  // Waits until `ready`; false: the scope has stopped before.
  template <typename Ready>
  static bool Wait(ConditionVariable& changed, MutexLock& lock, Ready&& ready) {
    if (current_ == nullptr) {
      changed.wait(lock, std::forward<Ready>(ready));
      return true;
    }
    constexpr auto kLook = std::chrono::milliseconds(20);
    while (!changed.wait_for(lock, kLook, ready)) {
      if (IsStopped()) return false;
    }
    return true;
  }
#endif

 private:
#if MTDB_THREADS
  // NOLINTNEXTLINE(readability-identifier-naming)
  static inline thread_local WaitScope* current_ = nullptr;
#else
  static inline WaitScope* current_ = nullptr;
#endif
  const std::function<bool()> stopped_;
  WaitScope* const outer_;
};

}  // namespace mtdb
