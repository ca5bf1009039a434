// What containers take of memory, about.
#pragma once

#include <cstddef>
#include <vector>

namespace mtdb::internal {

template <typename T>
size_t CapacityBytes(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}
// Of a map of the hashing kind: a node and its link, as allocated, and its buckets.
template <typename Map>
size_t MapBytes(const Map& map) {
  constexpr size_t kNode = sizeof(typename Map::value_type) + 2 * sizeof(void*);
  return map.size() * ((kNode + 15) / 16 * 16) + map.bucket_count() * sizeof(void*);
}

}  // namespace mtdb::internal
