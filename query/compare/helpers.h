// SPDX-License-Identifier: Apache-2.0
// Threads that help for a while.
#pragma once

#include <cstddef>
#include <system_error>
#include <thread>
#include <vector>

#include "store/base/out_of_memory.h"

namespace mtdb::internal {

// Runs `work`, which throws nothing, on this thread and up to `threads` - 1 others, fewer where no
// more can be made.
template <typename Work>
void WithHelpers(size_t threads, const Work& work) {
  std::vector<std::thread> helpers;
  static_cast<void>(TryAllocate([&] {
    try {
      while (helpers.size() + 1 < threads) helpers.emplace_back(work);
    } catch (const std::system_error&) {
    }
  }));
  work();
  for (std::thread& helper : helpers) helper.join();
}

}  // namespace mtdb::internal
