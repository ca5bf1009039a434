// SPDX-License-Identifier: Apache-2.0
// FailingAllocation: makes operator new, and the creation of threads, fail at a chosen point.
//
// A test program that has failing_allocation.cc among its sources (tests/CMakeLists.txt) has its
// operator new and pthread_create replaced. What malloc serves to C libraries does not fail.
#pragma once

#include <cstdint>
#include <type_traits>
#include <utility>

namespace mtdb::testing {

// While it lives, allocations of all threads are counted, the creation of a thread among them, and
// the n-th from now (1: the next) fails: with std::bad_alloc, or EAGAIN for a thread. One at a
// time.
class FailingAllocation {
 public:
  enum class Mode { kOnce, kFromThenOn };
  FailingAllocation(uint64_t nth, Mode mode);
  ~FailingAllocation();
  FailingAllocation(const FailingAllocation&) = delete;
  FailingAllocation& operator=(const FailingAllocation&) = delete;

  // Allocations that failed so far.
  uint64_t failures() const;
};

// For n = 1, 2, ... calls check(n, answer) with the answer that run() gives while its n-th
// allocation fails, once or from then on; ends with the first n that run() does not reach, whose
// answer is checked too. Returns that n. Only run() sees failures.
template <typename Run, typename Check>
uint64_t FailEachAllocation(FailingAllocation::Mode mode, Run&& run, Check&& check) {
  for (uint64_t n = 1;; ++n) {
    uint64_t failures = 0;
    auto answer = [&] {
      const FailingAllocation failing(n, mode);
      std::invoke_result_t<Run> result = run();
      failures = failing.failures();
      return result;
    }();
    check(n, std::move(answer));
    if (failures == 0) return n;
  }
}

}  // namespace mtdb::testing
