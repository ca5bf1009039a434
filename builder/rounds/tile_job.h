// SPDX-License-Identifier: Apache-2.0
// TileJob: a tile to be simplified, with all that this needs.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "builder/decimate/crumbs.h"
#include "builder/decimate/decimator.h"
#include "builder/disk/tile.h"
#include "builder/measure/filling_measure.h"
#include "builder/rounds/surface_window.h"
#include "builder/write/tile_cluster.h"
#include "store/base/attributes.h"
#include "store/base/grid.h"
#include "store/base/status.h"

namespace mtdb::internal {

// What the tiles of a build have in common.
struct TileSetting {
  Grid grid;
  AttributeLayout attributes;
  std::optional<TileTexture> texture;  // none: without
  std::optional<BorderPlane> border;   // none: borders keep their shape
  bool is_height_field = false;

  // Of a triangle's corner: a vertex's row and, of a textured object, a TextureCorner.
  size_t row_bytes() const {
    return attributes.row_bytes() + (texture ? sizeof(TextureCorner) : 0);
  }
};

// Numbers and bytes only: the outcome depends on them and on the kind of the decimator, so that the
// job may be done anywhere. What it answers is a TileOutcome.
struct TileJob {
  const TileSetting* setting = nullptr;
  uint32_t round = 1;
  uint64_t hilbert = 0;  // code of the first triangle on the round's curve
  TriangleBlock tile;
  std::vector<Crumb> crumbs;  // that have vanished from the tile
  CrumbCounts vanished;
  SurfaceBeneath beneath;
  RemovalLimits limits;
};

// Takes crumbs out of the job's tile, and finds the surface beneath it.
Status PrepareTile(const SurfaceWindow& surfaces, TileJob& job);

// `decimator` keeps nothing from one job to the next but its memory.
TileOutcome DoTile(const TileJob& job, TileDecimator& decimator);

}  // namespace mtdb::internal
