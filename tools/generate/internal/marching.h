// SPDX-License-Identifier: Apache-2.0
// The case table of marching cubes (Lorensen, Cline 1987), made from the enumeration of the 256
// cases so that the surface is always a manifold: on a face with four crossings the inside corners
// are kept apart, on both sides of the face alike, and no triangle inside a cube has an edge that
// joins two crossings of one face unless that edge is the contour on the face itself (two cubes
// that both did that would make an edge of four triangles).
#pragma once

#include <array>
#include <cstdint>

namespace mtdb::internal {

// Corner c of a cube lies at (c & 1, c >> 1 & 1, c >> 2). Edge e runs along axis e / 4 from corner
// kCubeEdgeStart[e]. Case: bit c is set when corner c is inside.
inline constexpr std::array<uint8_t, 12> kCubeEdgeStart = {0, 2, 4, 6, 0, 1, 4, 5, 0, 1, 2, 3};

struct MarchingCase {
  uint16_t edges = 0;          // bit e: edge e is crossed
  uint8_t triangle_count = 0;  // at most 5
  // Cube edges, counter-clockwise from outside.
  std::array<std::array<uint8_t, 3>, 5> triangles{};
};

// Made on the first call; thread-safe.
const std::array<MarchingCase, 256>& MarchingCases();

}  // namespace mtdb::internal
