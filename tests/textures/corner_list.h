// SPDX-License-Identifier: Apache-2.0
// The corners of a textured mesh, in an order that does not depend on that of its triangles.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

struct PlacedCorner {
  std::array<double, 3> place;
  float u, v;
  uint32_t page;
  friend auto operator<=>(const PlacedCorner&, const PlacedCorner&) = default;
};
using PlacedTriangle = std::array<PlacedCorner, 3>;

// Each triangle rotated so that its smallest corner comes first, sorted. u and v are rounded to the
// step, unless it is 0.
inline std::vector<PlacedTriangle> CornersOf(const TriangleMesh& mesh, double step) {
  std::vector<PlacedTriangle> all;
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    PlacedTriangle& corners = all.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      const Vec3d p = mesh.positions[mesh.triangles[t][c]];
      const TextureCorner& corner = mesh.corners.at(3 * t + c);
      const auto rounded = [&](float x) {
        return step > 0 ? static_cast<float>(std::floor(x / step + 0.5) * step) : x;
      };
      corners[c] = {{p.x, p.y, p.z}, rounded(corner.u), rounded(corner.v), corner.page};
    }
    std::rotate(corners.begin(), std::ranges::min_element(corners), corners.end());
  }
  std::ranges::sort(all);
  return all;
}

}  // namespace mtdb::testing
