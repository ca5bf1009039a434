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
// The same, with the vertices it uses (as float32 values).
TriangleMesh MeshByMeshopt(const TriangleMesh& mesh, uint64_t triangles);

}  // namespace mtdb
