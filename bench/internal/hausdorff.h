// SPDX-License-Identifier: Apache-2.0
// Measured distance between two meshes, outside of mtdb's own code: CGAL's AABB tree.
#pragma once

#include <cstdint>
#include <memory>

#include "store/base/mesh_sink.h"

namespace mtdb {

// Symmetric Hausdorff distances of many meshes from one: what is made of that one is kept. From all
// vertices and `samples` area-uniform points of either surface to the other one, in model units.
// Deterministic by `seed`.
class HausdorffMeter {
 public:
  HausdorffMeter(const TriangleMesh& mesh, uint64_t samples, uint64_t seed = 1);
  ~HausdorffMeter();
  HausdorffMeter(const HausdorffMeter&) = delete;
  HausdorffMeter& operator=(const HausdorffMeter&) = delete;

  double Distance(const TriangleMesh& other) const;
  struct Side;  // a surface and the points on it

 private:
  std::unique_ptr<Side> side_;
  uint64_t samples_;
  uint64_t seed_;
};

// Largest distance from `from`'s vertices and `samples` points on it to `to`.
double OneSidedHausdorff(const TriangleMesh& from, const TriangleMesh& to, uint64_t samples,
                         uint64_t seed = 1);

// The larger of both directions.
double SymmetricHausdorff(const TriangleMesh& a, const TriangleMesh& b, uint64_t samples,
                          uint64_t seed = 1);

// The distance of every vertex of `from` from `to` is measured, and the largest one returned: what
// programs do that compare scans. With all threads.
double LargestVertexDistance(const TriangleMesh& from, const TriangleMesh& to);

}  // namespace mtdb
