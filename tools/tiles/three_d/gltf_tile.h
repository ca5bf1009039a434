// SPDX-License-Identifier: Apache-2.0
// EncodeGltfTile: a tile as binary glTF, quantised and compressed.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "store/base/bytes.h"
#include "store/base/geometry.h"
#include "store/base/status.h"

namespace mtdb {

// A part of a level's mesh. Positions are points of a lattice: `origin` + `step` * i, with z up.
struct GltfTile {
  Vec3d origin;
  double step = 1;
  std::vector<Vec3i> positions;                 // from 0 on, below 2^24
  std::vector<Vec3f> normals;                   // of length 1; as many as positions, or none
  std::vector<std::array<uint8_t, 4>> colours;  // sRGB; as many as positions, or none
  std::vector<uint32_t> indices;                // three for each triangle
  uint64_t surface_triangles = 0;               // those before the skirts
  double error_bound = 0;
};

// Vertices and triangles are put in an order that suits graphics cards, skirts behind the rest; of
// skirts each vertex and triangle stays behind those of the surface. Positions are uint16, or
// float32 with whole numbers where one is above 65,535: in both cases exact (KHR_mesh_quantization,
// EXT_meshopt_compression). The node has z up become y up, as clients of 3D Tiles expect it, and
// `extras` have "errorBound" and "surfaceTriangles".
Bytes EncodeGltfTile(GltfTile tile);

// Positions, triangles and what is said of them; without normals and colours. kCorrupt.
Result<GltfTile> DecodeGltfTile(ByteSpan bytes);

}  // namespace mtdb
