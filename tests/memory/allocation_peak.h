// SPDX-License-Identifier: Apache-2.0
// How much memory is taken from the heap: operator new is replaced in the program that this is
// linked into.
#pragma once

#include <cstddef>

namespace mtdb::testing {

// The most that this thread has had at once, through operator new, beyond what it had when this was
// made. One at a time.
class AllocationPeak {
 public:
  AllocationPeak();
  size_t bytes() const;

 private:
  size_t before_;
};

}  // namespace mtdb::testing
