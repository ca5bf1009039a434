// SPDX-License-Identifier: Apache-2.0
// ErrorQueue: the work of a search with budgets, from level to level.
#pragma once

#include <cstdint>
#include <queue>
#include <utility>
#include <vector>

#include "query/internal/loaded_unit.h"

namespace mtdb::internal {

// A node to apply, or a cluster to look into: wanted at levels below this.
struct ErrorTask {
  int level = 0;
  bool look = false;
  UnitId unit = 0;
  NodeIndex node = 0;
};

// Order: higher levels; of one level, larger units, which are coarser; of one unit, looks; then
// smaller nodes.
class ErrorQueue {
 public:
  bool empty() const { return heap_.empty(); }
  void Push(const ErrorTask& task) {
    const uint64_t what = uint64_t{task.look} << 32 | uint32_t{~task.node};
    heap_.push({static_cast<uint64_t>(task.level) << 32 | task.unit, what});
  }
  ErrorTask Pop() {
    const auto [where, what] = heap_.top();
    heap_.pop();
    return {static_cast<int>(where >> 32), (what >> 32) != 0, static_cast<UnitId>(where),
            ~static_cast<uint32_t>(what)};
  }

 private:
  std::priority_queue<std::pair<uint64_t, uint64_t>> heap_;
};

}  // namespace mtdb::internal
