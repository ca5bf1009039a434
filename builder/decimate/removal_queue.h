// SPDX-License-Identifier: Apache-2.0
// RemovalQueue: which vertex comes next.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "store/base/ids.h"

namespace mtdb::internal {

// Vertices by their errors, or guesses of them; the smallest comes first, ties by number. A vertex
// that is pushed again has its new place alone.
class RemovalQueue {
 public:
  void Reset(uint32_t vertices) {
    errors_.assign(vertices, 0);
    heap_.clear();
  }
  void Push(uint32_t v, double error) {
    errors_[v] = static_cast<float>(error);
    heap_.push_back(Key(v));
    std::push_heap(heap_.begin(), heap_.end(), std::greater<>());
  }
  // A neighbour has changed, so that the error of `v` is stale, and mostly larger than it was. A
  // vertex that is not in the queue any more, for its error was too large, comes behind all others.
  void PushStale(uint32_t v) { Push(v, kStaleGrowth * errors_[v]); }
  std::optional<uint32_t> Pop() {
    while (!heap_.empty()) {
      std::pop_heap(heap_.begin(), heap_.end(), std::greater<>());
      const uint64_t key = heap_.back();
      heap_.pop_back();
      const auto v = static_cast<uint32_t>(key);
      if (key != Key(v)) continue;
      errors_[v] = kNotQueued;  // an older entry may be the same
      return v;
    }
    return std::nullopt;
  }
  // What a vertex in the queue has at least; infinity when it is empty but for those behind all
  // others.
  float cheapest() const {
    constexpr float kNone = std::numeric_limits<float>::infinity();
    const float first =
        heap_.empty() ? kNone : std::bit_cast<float>(static_cast<uint32_t>(heap_[0] >> 32));
    return first < 0 ? kNone : first;
  }
  // True when a vertex may be in the queue that is cheaper than this.
  bool HasCheaperThan(double error) const { return static_cast<float>(error) > cheapest(); }

 private:
  static constexpr float kNotQueued = -1;
  static constexpr double kStaleGrowth = 1.08;  // docs/notes/2026-11-order-of-removals.md

  // The bits of a vertex's error above its number: for errors of at least 0 in their order, for
  // others above all of these. An entry that differs from its vertex's key is void.
  uint64_t Key(uint32_t v) const { return uint64_t{std::bit_cast<uint32_t>(errors_[v])} << 32 | v; }

  std::vector<float> errors_;  // where the queue holds each vertex
  std::vector<uint64_t> heap_;
};

}  // namespace mtdb::internal
