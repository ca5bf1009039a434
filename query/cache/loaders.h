// SPDX-License-Identifier: Apache-2.0
// Loaders: units that are to be loaded for a query that does not wait for them, and threads for it.
#pragma once

#include <cstddef>
#include <functional>
#include <queue>
#include <system_error>
#include <utility>
#include <vector>

#include "query/cache/cache_user.h"
#include "store/base/ids.h"
#include "store/base/out_of_memory.h"
#include "store/base/threading.h"

namespace mtdb::internal {

// The coarsest unit is the first, whoever wants it. All is done with the mutex held; threads sleep
// while there is no job. Whoever waits for something else can do a job meanwhile.
class Loaders {
 public:
  struct Job {
    UnitId unit;
    CacheUserPtr user;
    friend bool operator<(const Job& a, const Job& b) { return a.unit < b.unit; }
  };
  // Does a job, and lets go of the mutex meanwhile; false when there was nothing to do.
  using Run = std::function<bool(const Job&, MutexLock&)>;

  Loaders(Mutex& mutex, unsigned most_threads, Run run)
      : mutex_(mutex), most_threads_(most_threads), run_(std::move(run)) {}
  ~Loaders() { Stop(); }
  Loaders(const Loaders&) = delete;
  Loaders& operator=(const Loaders&) = delete;

  // As many threads as can be made: a query does without.
  void Start() {
#if MTDB_THREADS
    static_cast<void>(TryAllocate([&] {
      try {
        while (threads_.size() < most_threads_) threads_.emplace_back([this] { Work(); });
      } catch (const std::system_error&) {
      }
    }));
#endif
  }
  // Without the mutex: ends them, and jobs that they have not begun stay.
  void Stop() {
    {
      const MutexLock lock(mutex_);
      stopping_ = true;
    }
    work_.notify_all();
#if MTDB_THREADS
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
#endif
  }
  bool has_threads() const {
#if MTDB_THREADS
    return !threads_.empty();
#else
    return false;
#endif
  }

  void Push(UnitId unit, CacheUserPtr user) { jobs_.push({unit, std::move(user)}); }
  // After Push.
  void Wake() { work_.notify_all(); }
  void RemoveJobsOf(const CacheUserPtr& user) {
    std::vector<Job> others;
    for (; !jobs_.empty(); jobs_.pop()) {
      if (jobs_.top().user != user) others.push_back(jobs_.top());
    }
    for (Job& job : others) jobs_.push(std::move(job));
  }
  // The first job for which there is something to do; false when there is none.
  bool RunOne(MutexLock& lock) {
    while (!jobs_.empty()) {
      const Job job = jobs_.top();
      jobs_.pop();
      if (run_(job, lock)) return true;
    }
    return false;
  }

 private:
  void Work() {
#if MTDB_THREADS
    MutexLock lock(mutex_);
    while (!stopping_) {
      if (!RunOne(lock)) work_.wait(lock);
    }
#endif
  }

  Mutex& mutex_;
  const unsigned most_threads_;
  const Run run_;
  ConditionVariable work_;  // there are jobs
  std::priority_queue<Job> jobs_;
  bool stopping_ = false;
#if MTDB_THREADS
  std::vector<std::thread> threads_;
#endif
};

}  // namespace mtdb::internal
