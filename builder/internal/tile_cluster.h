// TileCluster: from a decimated tile to a compressed cluster and the next round's triangles.
#pragma once

#include <span>
#include <vector>

#include "builder/internal/tile.h"
#include "codecs/cluster_codec.h"
#include "store/base/attributes.h"
#include "store/base/grid.h"
#include "store/cluster_index.h"

namespace mtdb {

struct TileCluster {
  bool empty = true;  // nothing could be removed: no cluster
  ClusterEntry entry;
  EncodedCluster encoded;
  // The simplified tile. Those that this cluster's nodes remove have child == kOwnCluster, to be
  // replaced once the cluster has its id.
  std::vector<TileTriangle> triangles;
  Bytes rows;           // of their corners, 3 a triangle
  uint32_t height = 0;  // longest path of nodes from one of its nodes to the drain
  uint32_t max_degree = 0;
  static constexpr uint32_t kOwnCluster = 0xfffffffe;
};

// `rows` holds the attributes of the tile's corners, 3 rows a triangle.
TileCluster MakeTileCluster(std::span<const TileTriangle> tile, const TileResult& result,
                            const Grid& grid, const AttributeLayout& attributes, const Bytes& rows);

}  // namespace mtdb
