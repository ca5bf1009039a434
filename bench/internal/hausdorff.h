// Measured distance between two meshes, outside of mtdb's own code: CGAL's AABB tree.
#pragma once

#include <cstdint>

#include "store/base/mesh_sink.h"

namespace mtdb {

// Largest distance from `from`'s vertices and `samples` area-uniform points on it to `to`, in model
// units. Deterministic by `seed`.
double OneSidedHausdorff(const TriangleMesh& from, const TriangleMesh& to, uint64_t samples,
                         uint64_t seed = 1);

// The larger of both directions.
double SymmetricHausdorff(const TriangleMesh& a, const TriangleMesh& b, uint64_t samples,
                          uint64_t seed = 1);

}  // namespace mtdb
