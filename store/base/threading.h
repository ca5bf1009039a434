// SPDX-License-Identifier: Apache-2.0
// Whether the library has threads: the one place that decides.
//
// Without them (WebAssembly as it comes, or MTDB_THREADS=0) locks are empty, nothing waits, and a
// query that lacks a unit fails with kNotYet instead: whoever drives the source asks again.
#pragma once

#ifndef MTDB_THREADS
#if defined(__wasm__) && !defined(__wasm_atomics__)
#define MTDB_THREADS 0
#else
#define MTDB_THREADS 1
#endif
#endif

#if MTDB_THREADS
#include <condition_variable>
#include <mutex>
#include <thread>
#endif

namespace mtdb {

inline constexpr bool kThreads = MTDB_THREADS != 0;

#if MTDB_THREADS

#define MTDB_THREAD_LOCAL thread_local
using Mutex = std::mutex;
using MutexLock = std::unique_lock<std::mutex>;
using ConditionVariable = std::condition_variable;
inline unsigned ProcessorCount() {
  const unsigned count = std::thread::hardware_concurrency();
  return count > 0 ? count : 1;
}

#else

#define MTDB_THREAD_LOCAL static

class Mutex {};

class MutexLock {
 public:
  explicit MutexLock(Mutex&) {}
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;
  ~MutexLock() = default;
  void lock() {}
  void unlock() {}
};

class ConditionVariable {
 public:
  void notify_all() {}
};

inline unsigned ProcessorCount() { return 1; }

#endif

}  // namespace mtdb
