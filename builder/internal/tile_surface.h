// SPDX-License-Identifier: Apache-2.0
// TileSurface: the surface that a tile's errors are measured against, when it is not the tile
// itself, and what of it each of the tile's triangles stands for.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "builder/internal/spool.h"
#include "builder/internal/tile.h"
#include "store/base/bytes.h"
#include "store/base/ids.h"
#include "store/base/status.h"

namespace mtdb::internal {

// A vertex of the surface that is removed.
struct HeldVertex {
  uint32_t vertex = 0;    // of TileSurface::vertices
  uint32_t triangle = 0;  // of the tile, in whose part it lies ...
  uint32_t edge = 3;      // ... or on the curve of this border edge of it; 3: inside
};

// The second round is measured against the mesh that the first began with, the input
// (docs/design.md, section 3). A tile of it is given such a surface.
struct TileSurface {
  // The surface's triangles that are not triangles of the tile.
  std::vector<uint32_t> vertices;  // the input's numbering
  std::vector<Vec3i> positions;    // grid
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<float> errors;
  // On a border edge's curve in the order in which they were removed from it.
  std::vector<HeldVertex> held;
  // Of the tile's triangles.
  std::vector<uint8_t> own;                        // it is one of the surface's itself
  std::vector<uint8_t> conservative;               // it has no curves
  std::vector<std::array<float, 3>> curve_errors;  // work units; of the curves of its edges

  bool empty() const { return triangles.empty(); }
};

// What a tile leaves for the next round: a surface whose triangles are those that the tile's
// cluster removes; "the tile's triangles" are the cluster's in-triangles.
Bytes EncodeTileSurface(const TileSurface& surface);
TileSurface DecodeTileSurface(ByteSpan bytes);

// The surfaces that the clusters of a round leave, by cluster. Add() from one thread, then
// Finish(), then Gather() from any number of threads.
class SurfaceSpool {
 public:
  SurfaceSpool(const SpoolSpace* space, size_t memory_bytes) : spool_(space, memory_bytes) {}

  // Clusters in the order of their ids, which follow each other.
  Status Add(UnitId cluster, ByteSpan surface);
  Status Finish() { return spool_.Finish(); }
  // The surface beneath `tile`, a tile of the round after.
  Result<TileSurface> Gather(std::span<const TileTriangle> tile) const;

 private:
  bool Has(UnitId cluster) const {
    return cluster >= first_ && cluster - first_ + size_t{1} < begin_.size();
  }
  Result<TileSurface> Read(UnitId cluster) const;

  Spool spool_;
  UnitId first_ = 0;
  std::vector<uint64_t> begin_{0};
};

}  // namespace mtdb::internal
