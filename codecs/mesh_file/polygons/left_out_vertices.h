// SPDX-License-Identifier: Apache-2.0
// LeftOutVertices: the vertices of a file that have no place, and the numbers of the others
// without them.
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "store/base/ids.h"

namespace mtdb::internal {

// Scanners that keep their samples' raster give NaN where they saw nothing. Such a vertex is left
// out; a face must not use it. Memory: a quarter of a byte for each vertex up to the last of them.
class LeftOutVertices {
 public:
  // In ascending order. `fault`: where it is and what is wrong; the first ones are kept.
  void Add(VertexIndex v, std::string fault) {
    while (bits_.size() <= v / kBits) {
      if (bits_.size() % kWords == 0) before_.push_back(count_);
      bits_.push_back(0);
    }
    bits_[v / kBits] |= uint64_t{1} << (v % kBits);
    ++count_;
    if (faults_.size() < kMostFaults) faults_.emplace_back(v, std::move(fault));
  }
  uint64_t count() const { return count_; }
  bool Has(VertexIndex v) const {
    return v / kBits < bits_.size() && (bits_[v / kBits] >> (v % kBits) & 1) != 0;
  }
  // The number of a vertex that is not left out.
  VertexIndex NumberOf(VertexIndex v) const {
    if (v / kBits >= bits_.size()) return v - count_;
    const uint64_t word = v / kBits;
    uint64_t before = before_[word / kWords];
    for (uint64_t w = word / kWords * kWords; w < word; ++w) before += Ones(bits_[w]);
    return v - before - Ones(bits_[word] & ((uint64_t{1} << (v % kBits)) - 1));
  }
  std::string FaultOf(VertexIndex v) const {
    for (const auto& [vertex, fault] : faults_) {
      if (vertex == v) return fault;
    }
    return "vertex " + std::to_string(v) + ": a coordinate is no finite number";
  }
  // That of the first one.
  const std::string& first_fault() const { return faults_.front().second; }

 private:
  static constexpr uint64_t kBits = 64;
  static constexpr uint64_t kWords = 8;  // that one number of before_ is for
  static constexpr size_t kMostFaults = 1000;
  static uint64_t Ones(uint64_t word) { return static_cast<uint64_t>(std::popcount(word)); }

  uint64_t count_ = 0;
  std::vector<uint64_t> bits_;
  std::vector<uint64_t> before_;
  std::vector<std::pair<VertexIndex, std::string>> faults_;
};

}  // namespace mtdb::internal
