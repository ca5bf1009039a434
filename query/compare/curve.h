// SPDX-License-Identifier: Apache-2.0
// SortAlongCurve: neighbours in space become neighbours in a list.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "store/base/geometry.h"

namespace mtdb::internal {

// Interleaves the bits of a place in the box, so that neighbours have near numbers.
inline uint64_t PlaceOnCurve(Vec3d p, const Box3d& within) {
  constexpr int kBits = 20;
  const Vec3d size = within.max - within.min;
  uint64_t place = 0;
  for (int i = 0; i < 3; ++i) {
    const double part = size[i] > 0 ? (p[i] - within.min[i]) / size[i] : 0;
    const auto cell = static_cast<uint64_t>(std::clamp(part, 0.0, 1.0) * ((1 << kBits) - 1));
    for (int bit = 0; bit < kBits; ++bit) place |= ((cell >> bit) & 1) << (3 * bit + i);
  }
  return place;
}

// By the points point_of(element), which lie in the box.
template <typename Element, typename PointOf>
void SortAlongCurve(std::vector<Element>& elements, const Box3d& within, const PointOf& point_of) {
  std::vector<std::pair<uint64_t, uint32_t>> order;
  order.reserve(elements.size());
  for (uint32_t i = 0; i < elements.size(); ++i) {
    order.emplace_back(PlaceOnCurve(point_of(elements[i]), within), i);
  }
  std::ranges::sort(order);
  std::vector<Element> sorted;
  sorted.reserve(elements.size());
  for (const auto& [place, i] : order) sorted.push_back(elements[i]);
  elements = std::move(sorted);
}

}  // namespace mtdb::internal
