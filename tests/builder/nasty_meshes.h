// SPDX-License-Identifier: Apache-2.0
// Small meshes by hand, each with something that breaks naive mesh code.
#pragma once

#include <string>
#include <vector>

#include "store/base/mesh_sink.h"
#include "store/object_record.h"

namespace mtdb::testing {

struct NastyMesh {
  std::string name;
  TriangleMesh mesh;   // vertices numbered (see NumberVertices), float32 coordinates
  InputReport report;  // expected; vertices and triangles are those of the mesh
  uint64_t components = 0;
  uint64_t boundary_edges = 0;
};

std::vector<NastyMesh> NastyMeshes();

// A height field of (n + 1)^2 vertices over the unit square, row by row, cut into 2 n^2 triangles.
TriangleMesh MakeSheet(int n, double roughness = 0.05, uint32_t seed = 1);

}  // namespace mtdb::testing
