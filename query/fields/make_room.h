// SPDX-License-Identifier: Apache-2.0
// MakeRoomForOne: memory for what must not fail later.
#pragma once

#include <algorithm>
#include <vector>

namespace mtdb::internal {

// The next push_back needs no memory.
template <typename T>
void MakeRoomForOne(std::vector<T>& list) {
  constexpr size_t kFirst = 16;
  if (list.size() == list.capacity()) list.reserve(std::max(kFirst, 2 * list.size()));
}

}  // namespace mtdb::internal
