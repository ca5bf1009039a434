// SPDX-License-Identifier: Apache-2.0
// What a server's threads are for: jobs of clients, run in a fair order; and how threads tell the
// loop of what they did.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "store/base/status.h"
#include "tools/server/internal/fair_queue.h"

namespace mtdb::internal {

// What threads ask the loop's thread to do, in order. Nothing is lost when memory is out: who holds
// a letter can post it.
class ServerMail {
 public:
  using Letter = std::list<std::function<void()>>;  // of one
  static Letter Write(std::function<void()> open) {
    Letter letter;
    letter.push_back(std::move(open));
    return letter;
  }

  ServerMail();  // throws std::system_error when there is no descriptor
  ~ServerMail();
  ServerMail(const ServerMail&) = delete;
  ServerMail& operator=(const ServerMail&) = delete;

  // Any thread, and Wake also a signal handler.
  void Post(Letter letter) noexcept;
  void Wake() const noexcept;
  // Readable when there are letters.
  int descriptor() const { return descriptor_; }
  // The loop's thread: opens all of them. When one throws, the rest stays for the next call.
  void Deliver();

 private:
  const int descriptor_;
  std::mutex mutex_;
  Letter letters_;
};

// Its threads are made when there is something to do for them. All but Job::work and ShouldYield
// happens on the loop's thread.
class ServerPool {
 public:
  struct Job {
    ServerClient client;
    bool is_long = false;             // is run where it does not keep others waiting
    std::function<void()> work;       // on a thread of the pool
    std::function<void()> done;       // then; `failed` when work threw
    std::function<void()> stop_soon;  // while it works: others wait. May be called once
    bool failed = false;

    // The pool's own.
    uint64_t id = 0;
    std::chrono::steady_clock::time_point begin;
    ServerMail::Letter letter;  // says that it is done
    Job* next_ready = nullptr;
  };
  using JobPtr = std::shared_ptr<Job>;

  struct Figures {
    std::atomic<uint64_t> waiting{0}, running{0}, preempted{0};
  };

  // So many short jobs at once, and so many long ones. `figures` are kept up to date.
  ServerPool(ServerMail& mail, const FairQueue::Limits& limits, Figures& figures);
  // Waits for what runs.
  ~ServerPool();
  // kNoSpace when there cannot be a single thread.
  Status Start();

  // The job waits for its turn. Its functions are let go of after `done`.
  void Submit(JobPtr job);
  // The job, if it waits still, will not be run; nothing of it is called. False: too late.
  bool Withdraw(const JobPtr& job);
  // Whether the job that runs should let others go first when it can. Any thread.
  bool ShouldYield(const Job& job) const;
  // Now and then: asks jobs to stop that have run for long while others wait.
  void Tick();

 private:
  double Now() const;
  void Dispatch();
  static void Clear(Job& job);
  bool AddThread();
  void Run();
  void OnDone(const JobPtr& job);

  ServerMail& mail_;
  const FairQueue::Limits limits_;
  Figures& figures_;
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  FairQueue queue_;
  uint64_t next_id_ = 0;
  std::map<uint64_t, JobPtr> jobs_;  // that wait or run
  std::atomic<bool> contended_{false};

  std::mutex mutex_;
  std::condition_variable wake_;
  Job* first_ready_ = nullptr;  // those that a thread may take
  Job* last_ready_ = nullptr;
  size_t ready_ = 0;
  size_t idle_ = 0;  // threads
  bool ending_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace mtdb::internal
