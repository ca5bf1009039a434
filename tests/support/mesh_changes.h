// SPDX-License-Identifier: Apache-2.0
// Small changes of meshes that many tests make.
#pragma once

#include <cstdint>
#include <cstring>

#include "store/base/mesh_sink.h"

namespace mtdb::testing {

// Makes each coordinate a float32 value.
inline void RoundToFloat32(TriangleMesh* mesh) {
  for (Vec3d& p : mesh->positions) {
    for (int i = 0; i < 3; ++i) {
      // g++ 12 leaves the rounding out where it vectorises it; volatile keeps it.
      volatile auto rounded = static_cast<float>(p[i]);
      p[i] = rounded;
    }
  }
  mesh->header.double_positions = false;
}

// Adds the attribute "id", each vertex's number, so that what comes back can be told apart even
// where positions coincide.
inline void NumberVertices(TriangleMesh* mesh) {
  mesh->header.attributes.attributes = {{"id", ScalarType::kUint32}};
  mesh->rows.resize(4 * mesh->positions.size());
  for (size_t v = 0; v < mesh->positions.size(); ++v) {
    const auto id = static_cast<uint32_t>(v);
    std::memcpy(mesh->rows.data() + 4 * v, &id, 4);
  }
}

}  // namespace mtdb::testing
