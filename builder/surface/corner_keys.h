// SPDX-License-Identifier: Apache-2.0
// Of triangles of a textured mesh: by what seams are found, and how long their edges are.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <span>

#include "builder/intake/corner_spool.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"
#include "store/base/hash.h"

namespace mtdb::internal {

// Of a corner at v of a textured mesh: numbers that are equal on both sides of an edge when the
// corners at both of its ends are; and one of the triangle, whichever way it runs.
struct CornerKeys {
  uint64_t at_a = 0, at_b = 0;  // of the edges (v, a) and (v, b)
  uint64_t triangle = 0;
};
// Of a triangle's edges (0, 1), (1, 2), (2, 0), and of the triangle.
using TriangleKeys = std::array<uint64_t, 4>;

// Of the edges, each by its ends in the order of their numbers, and of the triangle.
inline TriangleKeys KeysOf(const std::array<uint32_t, 3>& v, const TriangleCorners& corners) {
  TriangleKeys keys{};
  for (size_t i = 0; i < 3; ++i) {
    const size_t j = (i + 1) % 3;
    const std::array<TextureCorner, 2> ends =
        v[i] < v[j] ? std::array{corners[i], corners[j]} : std::array{corners[j], corners[i]};
    keys[i] = Hash64(std::as_bytes(std::span(ends)));
    keys[3] += Hash64(std::as_bytes(std::span(corners).subspan(i, 1)), v[i]);
  }
  return keys;
}

// Adds a triangle's edges. One that is a point of its page, or nearly so, as where a colour is
// taken from a palette, says nothing of what lengths in the image are.
inline void AddLengths(const std::array<Vec3i, 3>& positions, const Grid& grid,
                       const TriangleCorners& corners, double step, double* lengths,
                       double* texture_lengths) {
  constexpr double kLeastSteps = 16;
  if (corners[0].page == TextureCorner::kNoPage) return;
  double in_space = 0, in_image = 0;
  for (size_t i = 0; i < 3; ++i) {
    const size_t j = (i + 1) % 3;
    in_space += Length(grid.Position(positions[j]) - grid.Position(positions[i]));
    in_image +=
        std::hypot(double{corners[j].u} - corners[i].u, double{corners[j].v} - corners[i].v);
  }
  if (in_image <= kLeastSteps * step) return;
  *lengths += in_space;
  *texture_lengths += in_image;
}

}  // namespace mtdb::internal
