// SPDX-License-Identifier: Apache-2.0
// OrderedPipeline: jobs done by a few threads, taken back in the order in which they were given.
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

namespace mtdb::internal {

// Submit and Take are called by one thread. With one worker, or where no thread can be made, the
// work is done inside Submit; where fewer can be made than were asked for, these do it all.
template <typename Job>
class OrderedPipeline {
 public:
  // `worker` < workers. What `work(worker, job)` throws, Submit or the job's Take throws.
  OrderedPipeline(unsigned workers, std::function<void(unsigned, Job&)> work)
      : work_(std::move(work)) {
    if (workers <= 1) return;
    threads_.reserve(workers);
    try {
      for (unsigned w = 0; w < workers; ++w) threads_.emplace_back([this, w] { Run(w); });
    } catch (const std::system_error&) {  // no more threads
    } catch (const std::bad_alloc&) {
    }
  }
  ~OrderedPipeline() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_all();
  }
  OrderedPipeline(const OrderedPipeline&) = delete;
  OrderedPipeline& operator=(const OrderedPipeline&) = delete;

  size_t in_flight() const { return jobs_.size(); }

  void Submit(Job job) {
    auto slot = std::make_unique<Slot>();
    slot->job = std::move(job);
    if (threads_.empty()) {
      work_(0, slot->job);
      slot->done = true;
      jobs_.push_back(std::move(slot));
      return;
    }
    jobs_.push_back(std::move(slot));
    {
      const std::lock_guard lock(mutex_);
      waiting_.push_back(jobs_.back().get());
    }
    wake_.notify_one();
  }

  // The oldest job, once it is done. There must be one.
  Job Take() {
    std::unique_ptr<Slot> slot = std::move(jobs_.front());
    jobs_.pop_front();
    std::unique_lock lock(mutex_);
    finished_.wait(lock, [&] { return slot->done; });
    if (slot->error) std::rethrow_exception(slot->error);
    return std::move(slot->job);
  }

 private:
  struct Slot {
    Job job;
    bool done = false;         // guarded by mutex_
    std::exception_ptr error;  // likewise
  };

  void Run(unsigned worker) {
    std::unique_lock lock(mutex_);
    for (;;) {
      wake_.wait(lock, [&] { return stop_ || !waiting_.empty(); });
      if (stop_) return;
      Slot* slot = waiting_.front();
      waiting_.pop_front();
      lock.unlock();
      std::exception_ptr error;
      try {
        work_(worker, slot->job);
      } catch (...) {
        error = std::current_exception();
      }
      lock.lock();
      slot->error = std::move(error);
      slot->done = true;
      finished_.notify_all();
    }
  }

  std::function<void(unsigned, Job&)> work_;
  std::mutex mutex_;
  std::condition_variable wake_, finished_;
  std::deque<Slot*> waiting_;               // guarded by mutex_
  bool stop_ = false;                       // guarded by mutex_
  std::deque<std::unique_ptr<Slot>> jobs_;  // in order; the caller's thread only
  std::vector<std::jthread> threads_;       // last: joined first
};

}  // namespace mtdb::internal
