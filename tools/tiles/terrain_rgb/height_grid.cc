// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/terrain_rgb/height_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <utility>

#include "tools/tiles/places/globe_grid.h"

namespace mtdb {

namespace {

// What a parallel cuts out of a triangle: from the west to the east.
struct Stretch {
  Vec3d west{std::numeric_limits<double>::infinity(), 0, 0};
  Vec3d east{-std::numeric_limits<double>::infinity(), 0, 0};
  void Add(Vec3d p) {
    if (p.x < west.x) west = p;
    if (p.x > east.x) east = p;
  }
};

Stretch Cut(const Triangle3d& corners, double latitude) {
  Stretch stretch;
  for (size_t i = 0; i < 3; ++i) {
    Vec3d a = corners[i], b = corners[(i + 1) % 3];
    if (b <= a) std::swap(a, b);
    if (std::min(a.y, b.y) > latitude || std::max(a.y, b.y) < latitude) continue;
    if (a.y == b.y) {
      stretch.Add(a);
      stretch.Add(b);
      continue;
    }
    const double t = (latitude - a.y) / (b.y - a.y);
    stretch.Add(a + t * (b - a));
  }
  return stretch;
}

}  // namespace

HeightGrid::HeightGrid(uint32_t level, uint32_t x, uint32_t y, uint32_t side)
    : longitudes_(side),
      latitudes_(side),
      heights_(size_t{side} * side, std::numeric_limits<double>::quiet_NaN()) {
  const double pixel = std::ldexp(360.0 / side, -static_cast<int>(level));
  for (uint32_t i = 0; i < side; ++i) {
    longitudes_[i] = (static_cast<double>(x) * side + i + 0.5) * pixel - 180;
    latitudes_[i] = LatitudeOf(180 - (static_cast<double>(y) * side + i + 0.5) * pixel);
  }
}

void HeightGrid::Add(const Triangle3d& corners) {
  const auto [south, north] = std::minmax({corners[0].y, corners[1].y, corners[2].y});
  const auto first =
      std::lower_bound(latitudes_.begin(), latitudes_.end(), north, std::greater<>());
  for (auto row = first; row != latitudes_.end() && *row >= south; ++row) {
    const Stretch s = Cut(corners, *row);
    const double width = s.east.x - s.west.x;
    double* const of_row = heights_.data() + (row - latitudes_.begin()) *
                                                 static_cast<std::ptrdiff_t>(longitudes_.size());
    for (auto column = std::lower_bound(longitudes_.begin(), longitudes_.end(), s.west.x);
         column != longitudes_.end() && *column <= s.east.x; ++column) {
      const double t = width > 0 ? (*column - s.west.x) / width : 0;
      of_row[column - longitudes_.begin()] = s.west.z + t * (s.east.z - s.west.z);
    }
  }
}

}  // namespace mtdb
