// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/vertex_heights.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "store/base/ids.h"

namespace mtdb::internal {

namespace {
constexpr double kNowhere = std::numeric_limits<double>::infinity();
// So many times as far as the two nearest neighbours of a vertex are others that say little of its
// height, where one vertex of kFew has such, and where fewer do.
constexpr double kFar = 16;
constexpr double kVeryFar = 128;
constexpr size_t kFew = 8;

// Of vertices whose other neighbours are far away: off the line between the two nearest.
void LowerHeightsOfNeedles(std::span<const std::array<uint32_t, 3>> triangles,
                           std::span<const Vec3d> positions, std::vector<double>& heights) {
  struct Reach {
    std::array<uint32_t, 2> nearest{kNone32, kNone32};
    std::array<double, 2> squared{kNowhere, kNowhere};
    double farthest = 0;  // squared
  };
  std::vector<Reach> reaches(positions.size());
  for (const auto& t : triangles) {
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t a = t[c];
      const uint32_t b = t[c == 2 ? 0 : c + 1];
      const double squared = SquaredLength(positions[b] - positions[a]);
      for (const auto& [v, other] : {std::pair(a, b), std::pair(b, a)}) {
        Reach& reach = reaches[v];
        reach.farthest = std::max(reach.farthest, squared);
        if (squared >= reach.squared[1] || other == reach.nearest[0]) continue;
        const size_t at = squared < reach.squared[0] ? 0 : 1;
        if (at == 0) {
          reach.nearest[1] = reach.nearest[0];
          reach.squared[1] = reach.squared[0];
        }
        reach.nearest[at] = other;
        reach.squared[at] = squared;
      }
    }
  }
  const auto is_farther = [](const Reach& r, double times) {
    return r.farthest > times * times * r.squared[1];
  };
  const auto far = static_cast<size_t>(
      std::ranges::count_if(reaches, [&](const Reach& r) { return is_farther(r, kFar); }));
  const double least = far * kFew < reaches.size() ? kVeryFar : kFar;
  for (uint32_t v = 0; v < reaches.size(); ++v) {
    if (!is_farther(reaches[v], least)) continue;
    const auto [a, b] = reaches[v].nearest;
    const double squared = SquaredDistancePointSegment(positions[v], positions[a], positions[b]);
    heights[v] = std::min(heights[v], std::sqrt(squared));
  }
}
}  // namespace

std::vector<double> VertexHeights(std::span<const std::array<uint32_t, 3>> triangles,
                                  std::span<const Vec3d> positions, bool vertical) {
  const size_t vertices = positions.size();
  std::vector<Vec3d> sums(vertices);
  std::vector<Vec3d> normals(vertices);
  std::vector<uint32_t> counts(vertices, 0);
  for (const auto& t : triangles) {
    const Vec3d a = positions[t[0]];
    const Vec3d b = positions[t[1]];
    const Vec3d c = positions[t[2]];
    const Vec3d normal = Cross(b - a, c - a);
    for (const uint32_t v : t) {
      sums[v] += a + b + c - positions[v] * 3;
      normals[v] += normal;
      counts[v] += 2;
    }
  }
  std::vector<double> heights(vertices, 0);
  for (size_t v = 0; v < vertices; ++v) {
    if (vertical) {
      heights[v] = std::abs(sums[v].z) / counts[v];
      continue;
    }
    const double length = Length(normals[v]);
    if (length > 0) heights[v] = std::abs(Dot(sums[v], normals[v])) / (length * counts[v]);
  }
  if (!vertical) LowerHeightsOfNeedles(triangles, positions, heights);
  return heights;
}

}  // namespace mtdb::internal
