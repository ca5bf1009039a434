// SPDX-License-Identifier: Apache-2.0
// meshoptimizer's simplification, as a peer for quality and speed.
#pragma once

#include <cstdint>
#include <vector>

#include "store/base/mesh_sink.h"

namespace mtdb {

// The mesh as meshoptimizer takes it.
struct MeshoptInput {
  explicit MeshoptInput(const TriangleMesh& mesh);
  std::vector<float> positions;  // x, y, z
  std::vector<uint32_t> indices;
};

// meshopt_simplify with any error permitted: vertices are a subset of the input's. May leave more
// than `triangles` where the topology forbids collapses.
std::vector<uint32_t> SimplifyByMeshopt(const MeshoptInput& input, uint64_t triangles);
// Likewise, until the next collapse would be off by more than `error_model`, as far as
// meshoptimizer's estimate knows.
std::vector<uint32_t> SimplifyByMeshoptToError(const MeshoptInput& input, double error_model);
// The triangles that are left, with the vertices that they use (as float32 values).
TriangleMesh MeshOf(const MeshoptInput& input, const std::vector<uint32_t>& indices);
// SimplifyByMeshopt as a mesh.
TriangleMesh MeshByMeshopt(const TriangleMesh& mesh, uint64_t triangles);

}  // namespace mtdb
