// SPDX-License-Identifier: Apache-2.0
// Named points in the life of an object, at which a crash test may kill its process.
#pragma once

#include <functional>

namespace mtdb::internal {

// Called with the point's name; empty outside of tests. Set it before any thread starts.
std::function<void(const char* point)>& TestPointHook();

inline void ReachTestPoint(const char* point) {
  if (const auto& hook = TestPointHook()) hook(point);
}

}  // namespace mtdb::internal
