// SPDX-License-Identifier: Apache-2.0
// Rounds of a build that go on from each other, without files and threads.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "builder/disk/tile.h"
#include "builder/measure/tile_surface.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"
#include "store/base/ids.h"
#include "store/base/mesh_sink.h"

namespace mtdb::testing {

// Of several tiles each: the first one to a quarter, later ones to a half of their triangles.
class Rounds {
 public:
  // Runs the first one. `error`: of all triangles that it begins with.
  Rounds(const TriangleMesh& mesh, size_t tiles, float error = 0);
  // The next round, of tiles for which begins_afresh(i) is false. `over`: its clusters leave
  // nothing.
  void Run(size_t tiles, const std::function<bool(size_t)>& begins_afresh = {}, bool over = false);

  Grid grid;
  std::vector<internal::TileTriangle> before, after;
  std::vector<uint32_t> removed;
  std::vector<std::unique_ptr<internal::SurfaceSpool>> surfaces;  // of the rounds

 private:
  Box3d bounds_;
  UnitId next_ = 7;
};

}  // namespace mtdb::testing
