// SPDX-License-Identifier: Apache-2.0
// ErrorQueue: the work of a search with budgets, largest error first.
#pragma once

#include <array>
#include <cstdint>
#include <queue>
#include <vector>

#include "query/internal/loaded_unit.h"

namespace mtdb::internal {

// A node to apply, or a cluster to look into.
struct ErrorTask {
  uint8_t code = 0;
  bool look = false;
  UnitId unit = 0;
  NodeIndex node = 0;
};

// Order: larger codes; of one code, looks; then larger units; then smaller nodes.
class ErrorQueue {
 public:
  bool empty() const { return size_ == 0; }
  void Push(const ErrorTask& task) {
    heaps_[task.code].push((uint64_t{task.look} << 63) | (uint64_t{task.unit} << 32) |
                           uint32_t{~task.node});
    if (size_++ == 0 || task.code > highest_) highest_ = task.code;
  }
  ErrorTask Pop() {
    while (heaps_[highest_].empty()) --highest_;
    const uint64_t key = heaps_[highest_].top();
    heaps_[highest_].pop();
    --size_;
    return {highest_, (key >> 63) != 0, static_cast<UnitId>(key >> 32) & ~kChildFlag,
            ~static_cast<uint32_t>(key)};
  }

 private:
  std::array<std::priority_queue<uint64_t>, 256> heaps_;  // by code
  size_t size_ = 0;
  uint8_t highest_ = 0;  // no code above it is there
};

}  // namespace mtdb::internal
