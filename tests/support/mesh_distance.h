// SPDX-License-Identifier: Apache-2.0
// How far a point is from a mesh, by its definition.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"

namespace mtdb::testing {

inline double DistanceTo(const TriangleMesh& mesh, Vec3d p) {
  double best = std::numeric_limits<double>::infinity();
  for (const TriangleVertices& t : mesh.triangles) {
    best = std::min(best, SquaredDistancePointTriangle(p, mesh.positions[t[0]],
                                                       mesh.positions[t[1]], mesh.positions[t[2]]));
  }
  return std::sqrt(best);
}

}  // namespace mtdb::testing
