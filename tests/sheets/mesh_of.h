// SPDX-License-Identifier: Apache-2.0
// Complexes as meshes of mtdb, and back.
#pragma once

#include "store/base/mesh_sink.h"
#include "tests/sheets/complex.h"

namespace mtdb::sheets {

inline TriangleMesh MeshOf(const Complex& complex) {
  TriangleMesh mesh;
  for (const Point& p : complex.points) mesh.positions.push_back({p[0], p[1], p[2]});
  for (const Triangle& t : complex.triangles) mesh.triangles.push_back({t[0], t[1], t[2]});
  mesh.header.double_positions = true;
  return mesh;
}

inline Complex ComplexOf(const TriangleMesh& mesh) {
  Complex complex;
  for (const Vec3d& p : mesh.positions) complex.points.push_back({p.x, p.y, p.z});
  for (const TriangleVertices& t : mesh.triangles) {
    complex.triangles.push_back(
        {static_cast<uint32_t>(t[0]), static_cast<uint32_t>(t[1]), static_cast<uint32_t>(t[2])});
  }
  return complex;
}

}  // namespace mtdb::sheets
