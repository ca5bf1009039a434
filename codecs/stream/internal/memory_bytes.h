// SPDX-License-Identifier: Apache-2.0
// What containers take of memory, about, and how they take less.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace mtdb::internal {

template <typename T>
size_t CapacityBytes(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}

// Of values that stay: a longer vector has room for a quarter more at most, and not for as many
// again.
template <typename T>
void ReserveTight(std::vector<T>& values, size_t size) {
  if (size > values.capacity()) {
    values.reserve(std::max(size, values.size() + values.size() / 4 + 16));
  }
}
template <typename T>
void ResizeTight(std::vector<T>& values, size_t size, const T& value = T()) {
  ReserveTight(values, size);
  values.resize(size, value);
}

}  // namespace mtdb::internal
