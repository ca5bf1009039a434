// SPDX-License-Identifier: Apache-2.0
// UpFinder: watches a build, and finds what is up from the first mesh of it that is small.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "builder/disk/tile.h"
#include "store/base/geometry.h"
#include "store/base/grid.h"

namespace mtdb::internal {

// Of the meshes that a build goes through, from the input to the root, it keeps the first with at
// most kMostTriangles, as that shows the shape with the least detail lost; when there is none, a
// part of the root, which then has many. Takes up to 3 MiB. What it finds does not depend on
// threads, memory, or a journal.
class UpFinder {
 public:
  static constexpr size_t kMostTriangles = 50'000;

  explicit UpFinder(bool wanted) : found_(!wanted) {}  // not wanted: it looks at nothing

  void Add(std::span<const TileTriangle> triangles);
  // All triangles of a mesh were added; another one begins. The root is the last.
  void End(bool is_root);
  // The direction, of a length of about 1; z of nothing.
  Vec3d Find(const Grid& grid) const;

 private:
  std::vector<std::array<Vec3i, 3>> kept_;
  uint64_t seen_ = 0;
  uint64_t every_ = 1;  // so many triangles are seen for each that is kept
  bool found_;
};

}  // namespace mtdb::internal
