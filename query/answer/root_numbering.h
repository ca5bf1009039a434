// SPDX-License-Identifier: Apache-2.0
// RootNumbering: output numbers of root vertices, in the order in which the root pieces name them.
#pragma once

#include <cstdint>
#include <vector>

#include "store/base/ids.h"

namespace mtdb::internal {

// Takes no memory while the vertices come in ascending order without gaps, which is how the
// builder numbers them; a table of all root vertices otherwise.
class RootNumbering {
 public:
  explicit RootNumbering(uint64_t root_vertices) : root_vertices_(root_vertices) {}

  // Numbers `vertex` (< root_vertices); false when it has a number already.
  bool Add(VertexIndex vertex) {
    if (numbers_.empty()) {
      if (vertex < count_) return false;
      if (vertex == count_) {
        ++count_;
        return true;
      }
      numbers_.assign(root_vertices_, kUnset);
      for (uint64_t i = 0; i < count_; ++i) numbers_[i] = i;
    }
    if (numbers_[vertex] != kUnset) return false;
    numbers_[vertex] = count_++;
    return true;
  }
  VertexIndex number(VertexIndex vertex) const {
    return numbers_.empty() ? vertex : numbers_[vertex];
  }
  uint64_t count() const { return count_; }

 private:
  static constexpr uint64_t kUnset = ~uint64_t{0};
  uint64_t root_vertices_;
  uint64_t count_ = 0;
  std::vector<uint64_t> numbers_;
};

}  // namespace mtdb::internal
