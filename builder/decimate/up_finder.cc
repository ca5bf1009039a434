// SPDX-License-Identifier: Apache-2.0
#include "builder/decimate/up_finder.h"

#include <cmath>

#include "store/base/estimate_up.h"

namespace mtdb::internal {

namespace {

constexpr double kSteps = 4096;  // of a component

}  // namespace

void UpFinder::Add(std::span<const TileTriangle> triangles) {
  if (found_) return;
  for (const TileTriangle& t : triangles) {
    if (seen_++ % every_ != 0) continue;
    if (kept_.size() == kMostTriangles) {
      // Every second one goes.
      for (size_t i = 0; 2 * i < kept_.size(); ++i) kept_[i] = kept_[2 * i];
      kept_.resize((kept_.size() + 1) / 2);
      every_ *= 2;
      if ((seen_ - 1) % every_ != 0) continue;
    }
    kept_.push_back(t.positions);
  }
}

void UpFinder::End(bool is_root) {
  found_ = found_ || every_ == 1 || is_root;
  if (found_) return;
  kept_.clear();
  seen_ = 0;
  every_ = 1;
}

Vec3d UpFinder::Find(const Grid& grid) const {
  TriangleMesh mesh;
  mesh.positions.reserve(3 * kept_.size());
  mesh.triangles.reserve(kept_.size());
  for (const std::array<Vec3i, 3>& t : kept_) {
    const auto first = static_cast<VertexIndex>(mesh.positions.size());
    for (const Vec3i& p : t) mesh.positions.push_back(grid.Position(p));
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  // So that roundings of its sums, in whatever order, do not tell.
  Vec3d up = EstimateUp(mesh);
  for (int i = 0; i < 3; ++i) up[i] = std::round(up[i] * kSteps) / kSteps;
  return up;
}

}  // namespace mtdb::internal
