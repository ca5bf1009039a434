// ParallelFor: runs a body for each index on a few threads.
#pragma once

#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

namespace mtdb {

// Calls body(worker, i) for every i < count, each once, on up to `threads` threads; returns when
// all are done. `worker` < threads names the thread, for its private memory.
template <typename Body>
void ParallelFor(size_t count, unsigned threads, Body&& body) {
  if (threads <= 1 || count <= 1) {
    for (size_t i = 0; i < count; ++i) body(0u, i);
    return;
  }
  std::atomic<size_t> next{0};
  std::vector<std::jthread> workers;
  for (unsigned w = 0; w < threads; ++w) {
    workers.emplace_back([&, w] {
      for (size_t i = next++; i < count; i = next++) body(w, i);
    });
  }
}

}  // namespace mtdb
