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
  explicit Places(std::optional<double> reach) : reach_(reach) {}

  // A part that exceeds the tolerance, or may.
  void Add(const ComparePlace& part);
  // The farthest first.
  std::vector<ComparePlace> Take();

 private:
  // Makes one place of those whose boxes, grown by this, meet.
  void Join(double within);

  // So many parts are joined at a time; more places than half of it come nearer to each other,
  // until they are fewer.
  static constexpr size_t kMost = size_t{1} << 16;
  const std::optional<double> reach_;
  std::vector<ComparePlace> places_;
};

}  // namespace mtdb::internal
