// SPDX-License-Identifier: Apache-2.0
// Reads trees of tiles as a client does, for tests.
#pragma once

#include <array>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {

using Corner = std::array<int64_t, 3>;  // a point of a level's lattice
using CornerTriangle = std::array<Corner, 3>;

// A tile of a tileset.json, or of one that it names.
struct ReadTile {
  std::string uri;  // from the folder of the tree; empty: no content
  double error = 0, bound = 0;
  std::array<double, 12> box{};
  std::vector<ReadTile> children;
};
// REQUIREs that boxes contain those of children, and that errors fall.
ReadTile ReadTileset(const std::string& folder);

struct ReadGltf {
  double step = 0;
  double bound = 0;
  std::vector<Vec3d> positions;  // z up
  std::vector<Corner> corners;   // likewise, on the lattice of all tiles from 0 on
  std::vector<Vec3d> normals;
  std::vector<std::array<uint32_t, 3>> surface, skirts;
};
ReadGltf ReadGlb(const std::string& path);

// Begins with the least corner.
CornerTriangle Sorted(CornerTriangle t);

// The tiles with a content, by level: the first number of their names.
void TilesByLevel(const ReadTile& tile, std::map<int, std::vector<const ReadTile*>>* levels);

struct ReadTerrain {
  double low = 0, high = 0;
  Vec3d centre, sphere, horizon;
  double radius = 0;
  std::vector<std::array<uint16_t, 3>> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
  std::array<std::vector<uint32_t>, 4> sides;  // west, south, east, north
  std::map<int, std::string> extensions;
};
ReadTerrain ReadQuantizedMesh(const std::string& path);

}  // namespace mtdb::test
