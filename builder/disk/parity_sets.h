// SPDX-License-Identifier: Apache-2.0
// ParitySets: numbers that become members of one set, each as the first one is or the other way.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace mtdb::internal {

// Union-find with a parity, and path halving.
class ParitySets {
 public:
  static constexpr uint32_t kMost = uint32_t{1} << 31;
  // Of the numbers 0 .. size - 1, each a set of its own.
  explicit ParitySets(size_t size = 0) {
    while (this->size() < size) Add();
  }
  size_t size() const { return links_.size(); }
  // The number size(), below kMost, becomes a set.
  void Add() { links_.push_back(static_cast<uint32_t>(size() << 1)); }

  struct Place {
    uint32_t first = 0;   // stands for the set
    bool turned = false;  // against that one
  };
  Place Find(uint32_t i) {
    bool turned = false;
    while (links_[i] >> 1 != i) {
      links_[i] = links_[links_[i] >> 1] ^ (links_[i] & 1);
      turned ^= (links_[i] & 1) != 0;
      i = links_[i] >> 1;
    }
    return {i, turned};
  }
  // Of two that stand for sets: `first` stands for both from now on.
  void Join(uint32_t first, uint32_t other, bool turned) {
    links_[other] = first << 1 | static_cast<uint32_t>(turned);
  }

 private:
  std::vector<uint32_t> links_;  // twice the number that each follows, and the parity
};

}  // namespace mtdb::internal
