// SPDX-License-Identifier: Apache-2.0
// How far points are from a mesh, by a box tree of its triangles.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "store/base/geometry.h"
#include "store/base/mesh_sink.h"

namespace mtdb::everything {

class DistanceTree {
 public:
  explicit DistanceTree(const TriangleMesh& mesh);
  // Infinite when the mesh has no triangle.
  double Distance(Vec3d p) const;

 private:
  struct Node {
    Box3d box;
    uint32_t begin = 0, end = 0;  // of triangles_
    uint32_t child = 0;           // the first of two; 0: a leaf
  };
  void Split(uint32_t node, int depth);
  std::vector<Triangle3d> triangles_;
  std::vector<Node> nodes_;
};

// Vertices of the mesh's triangles, and so many points spread evenly over them, by `seed`.
std::vector<Vec3d> SamplePoints(const TriangleMesh& mesh, uint64_t count, uint64_t seed);

}  // namespace mtdb::everything
