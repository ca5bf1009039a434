// SPDX-License-Identifier: Apache-2.0
// Places: parts of a surface that exceed a tolerance, joined where they touch.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "query/compare.h"

namespace mtdb::internal {

// One thread.
class Places {
 public:
  Places(std::optional<double> reach, size_t most) : reach_(reach), most_(most) {}

  // A part that exceeds the tolerance, or may.
  void Add(const ComparePlace& part);
  // The farthest first; at most `most`, and one.
  std::vector<ComparePlace> Take();

 private:
  // Makes one place of those whose boxes, grown by this, meet.
  void Join(double within);
  // Joins what touches, and what is nearer and nearer while more than `most_` places are left.
  void JoinUntilFew();

  const std::optional<double> reach_;
  const size_t most_;
  std::vector<ComparePlace> places_;
};

}  // namespace mtdb::internal
