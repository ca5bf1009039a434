// SPDX-License-Identifier: Apache-2.0
// TileCluster: from a decimated tile to a compressed cluster and the next round's triangles.
#pragma once

#include <optional>
#include <span>

#include "builder/disk/tile.h"
#include "builder/measure/tile_surface.h"
#include "codecs/cluster/cluster_codec.h"
#include "store/base/attributes.h"
#include "store/base/grid.h"
#include "store/cluster_index.h"

namespace mtdb::internal {

struct TileCluster {
  bool empty = true;  // nothing could be removed: no cluster
  UnitEntry entry;
  EncodedCluster encoded;
  // The simplified tile. Those that this cluster's nodes remove have child == kOwnCluster, to be
  // replaced once the cluster has its id.
  TriangleBlock left;
  Bytes surface;        // for a round that goes on from this one: see EncodeTileSurface
  uint32_t height = 0;  // longest path of nodes from one of its nodes to the drain
  uint32_t max_degree = 0;
  static constexpr uint32_t kOwnCluster = 0xfffffffe;
};

// What simplifying a tile leaves.
struct TileOutcome {
  TileCluster cluster;  // of one from a journal without what only the encoder needs
  uint64_t locked_vertices = 0;
  uint64_t seam_vertices = 0;  // of these, those that only the tile's seam locks
  uint64_t stuck_topology = 0;
  uint64_t stuck_degree = 0;
  uint64_t vanished_components = 0;
  uint64_t vanished_border_loops = 0;
};

// The surface that a tile was measured against.
struct MeasuredAgainst {
  uint32_t round = 0;  // that began with it; 0: the next round need not go on from it
  const TileSurface* surface = nullptr;  // null: the tile itself
};

// `crumbs`: that vanished from the input before it was simplified, one after the other.
TileCluster MakeTileCluster(const TriangleBlock& input, std::span<const Crumb> crumbs,
                            const TileResult& result, const Grid& grid,
                            const AttributeLayout& attributes,
                            const std::optional<TileTexture>& texture,
                            const MeasuredAgainst& against);

}  // namespace mtdb::internal
