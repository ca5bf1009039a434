// SPDX-License-Identifier: Apache-2.0
// Stopwatch: real time since it was made.
#pragma once

#include <chrono>

namespace mtdb::internal {

class Stopwatch {
 public:
  double Seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace mtdb::internal
