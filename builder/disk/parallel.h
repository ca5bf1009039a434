// SPDX-License-Identifier: Apache-2.0
// ParallelFor: runs a body for each index on a few threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

namespace mtdb::internal {

// Calls body(worker, i) for every i < count, each once, on up to `threads` threads, fewer where no
// more can be made; returns when all are done. `worker` < threads names the thread, for its private
// memory. Throws the first exception of a body; indices that nobody has begun are then left out.
template <typename Body>
void ParallelFor(size_t count, unsigned threads, Body&& body) {
  if (threads <= 1 || count <= 1) {
    for (size_t i = 0; i < count; ++i) body(0u, i);
    return;
  }
  std::atomic<size_t> next{0};
  std::mutex mutex;
  std::exception_ptr error;  // guarded by mutex until the threads are joined
  const auto run = [&](unsigned worker) {
    try {
      for (size_t i = next++; i < count; i = next++) body(worker, i);
    } catch (...) {
      next = count;
      const std::lock_guard lock(mutex);
      if (!error) error = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> workers;
    workers.reserve(threads);
    unsigned made = 0;
    try {
      for (; made < threads; ++made) workers.emplace_back([&run, made] { run(made); });
    } catch (const std::system_error&) {  // no more threads: this one helps
      run(made);
    } catch (const std::bad_alloc&) {
      run(made);
    }
  }
  if (error) std::rethrow_exception(error);
}

}  // namespace mtdb::internal
