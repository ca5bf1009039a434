// SPDX-License-Identifier: Apache-2.0
// LevelQueue: the work of a search with budgets, from level to level.
#pragma once

#include <cstdint>
#include <queue>
#include <vector>

#include "query/cache/loaded_unit.h"

namespace mtdb::internal {

// A node to apply, or a cluster to look into: wanted at levels below this.
struct LevelTask {
  int level = 0;
  bool look = false;
  UnitId unit = 0;
  NodeIndex node = 0;
};

// Order: higher levels; of one level, larger units, which are coarser; of one unit, looks; then
// smaller nodes.
class LevelQueue {
 public:
  bool empty() const { return size_ == 0; }
  void Push(const LevelTask& task) {
    const auto level = static_cast<size_t>(task.level);
    if (level >= heaps_.size()) heaps_.resize(level + 1);
    heaps_[level].push(uint64_t{task.unit} << 33 | uint64_t{task.look} << 32 |
                       uint32_t{~task.node});
    if (size_++ == 0 || level > highest_) highest_ = level;
  }
  LevelTask Pop() {
    while (heaps_[highest_].empty()) --highest_;
    const uint64_t key = heaps_[highest_].top();
    heaps_[highest_].pop();
    --size_;
    return {static_cast<int>(highest_), (key >> 32 & 1) != 0, static_cast<UnitId>(key >> 33),
            ~static_cast<uint32_t>(key)};
  }

 private:
  std::vector<std::priority_queue<uint64_t>> heaps_;  // by level
  size_t size_ = 0;
  size_t highest_ = 0;  // no level above it has tasks
};

}  // namespace mtdb::internal
