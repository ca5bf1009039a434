// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/meshopt_simplify.h"

#include <meshoptimizer.h>
#include <unordered_map>

namespace mtdb {

MeshoptInput::MeshoptInput(const TriangleMesh& mesh) {
  for (const Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) positions.push_back(static_cast<float>(p[i]));
  }
  for (const TriangleVertices& t : mesh.triangles) {
    for (const VertexIndex v : t) indices.push_back(static_cast<uint32_t>(v));
  }
}

namespace {
std::vector<uint32_t> Simplify(const MeshoptInput& input, uint64_t triangles, float error) {
  std::vector<uint32_t> result(input.indices.size());
  result.resize(meshopt_simplify(result.data(), input.indices.data(), input.indices.size(),
                                 input.positions.data(), input.positions.size() / 3,
                                 3 * sizeof(float), 3 * triangles, error, 0, nullptr));
  return result;
}
}  // namespace

std::vector<uint32_t> SimplifyByMeshopt(const MeshoptInput& input, uint64_t triangles) {
  constexpr float kAnyError = 1e10f;
  return Simplify(input, triangles, kAnyError);
}

std::vector<uint32_t> SimplifyByMeshoptToError(const MeshoptInput& input, double error_model) {
  const float scale =
      meshopt_simplifyScale(input.positions.data(), input.positions.size() / 3, 3 * sizeof(float));
  return Simplify(input, 0, static_cast<float>(error_model) / scale);
}

TriangleMesh MeshOf(const MeshoptInput& input, const std::vector<uint32_t>& indices) {
  TriangleMesh result;
  std::unordered_map<uint32_t, VertexIndex> number;
  for (size_t i = 0; i < indices.size(); ++i) {
    const auto [at, fresh] = number.try_emplace(indices[i], result.positions.size());
    if (fresh) {
      const float* p = input.positions.data() + size_t{3} * indices[i];
      result.positions.push_back({p[0], p[1], p[2]});
    }
    if (i % 3 == 0) result.triangles.emplace_back();
    result.triangles.back()[i % 3] = at->second;
  }
  return result;
}

TriangleMesh MeshByMeshopt(const TriangleMesh& mesh, uint64_t triangles) {
  const MeshoptInput input(mesh);
  return MeshOf(input, SimplifyByMeshopt(input, triangles));
}

}  // namespace mtdb
