// SPDX-License-Identifier: Apache-2.0
// What containers take of memory, about.
#pragma once

#include <cstddef>
#include <vector>

namespace mtdb::internal {

template <typename T>
size_t CapacityBytes(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}

}  // namespace mtdb::internal
