// SPDX-License-Identifier: Apache-2.0
// DisjointSets: numbers that become members of one set, pair by pair.
#pragma once

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace mtdb::internal {

// Union-find with path halving; the smallest number of a set stands for it.
class DisjointSets {
 public:
  // Of the numbers 0 .. size - 1, each a set of its own.
  explicit DisjointSets(size_t size = 0) : parent_(size) { Part(); }
  size_t size() const { return parent_.size(); }
  // The number size() becomes a set.
  void Add() { parent_.push_back(static_cast<uint32_t>(size())); }
  // All numbers are sets of their own again.
  void Part() { std::iota(parent_.begin(), parent_.end(), 0u); }
  uint32_t Find(uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  // False when both were of one set.
  bool Join(uint32_t a, uint32_t b) {
    a = Find(a);
    b = Find(b);
    parent_[std::max(a, b)] = std::min(a, b);
    return a != b;
  }
  // What so many more numbers make it take, at most and for a moment.
  uint64_t bytes_with(uint64_t more) const {
    return parent_.capacity() * sizeof(uint32_t) * (size() + more > parent_.capacity() ? 3 : 1);
  }

 private:
  std::vector<uint32_t> parent_;
};

}  // namespace mtdb::internal
