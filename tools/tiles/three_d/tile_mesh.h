// SPDX-License-Identifier: Apache-2.0
// MakeTileMesh: the triangles of a tile on the level's lattice, with skirts.
#pragma once

#include <cstdint>
#include <span>

#include "tools/tiles/level/level_mesh.h"
#include "tools/tiles/three_d/gltf_tile.h"

namespace mtdb {

struct TileMeshOptions {
  Vec3d origin;  // of the lattice
  double step = 1;
  bool colours = false;
  // Skirts hang so deep below the edges where the tile ends and the level's mesh goes on; 0: none.
  double skirt = 0;
  bool skirt_is_vertical = false;  // else against the normal
  // Every triangle of the level with a vertex in here is among the tile's: its edges have no skirt.
  Box3d inside;
};

// The point of the lattice that is nearest to `p`.
inline Vec3i LatticePoint(Vec3d p, Vec3d origin, double step) {
  Vec3i q;
  for (int i = 0; i < 3; ++i) {
    const double steps = (p[i] - origin[i]) / step;
    q[i] = static_cast<int32_t>(steps + (steps < 0 ? -0.5 : 0.5));
  }
  return q;
}

// Triangles that the lattice makes one point or line of two vertices are left out.
GltfTile MakeTileMesh(const LevelMesh& mesh, std::span<const LevelTriangle> triangles,
                      const TileMeshOptions& options);

}  // namespace mtdb
