#include "builder/internal/tile_cluster.h"

#include <algorithm>

namespace mtdb {

TileCluster MakeTileCluster(const TriangleBlock& input, const TileResult& result, const Grid& grid,
                            const AttributeLayout& attributes) {
  TileCluster cluster;
  const std::vector<TileTriangle>& tile = input.triangles;
  const auto input_count = static_cast<uint32_t>(tile.size());
  const double model_units = grid.mode == PositionMode::kGrid ? grid.step : 1.0;

  const size_t row = attributes.row_bytes();
  const auto append_row = [&](Bytes& to, uint64_t corner) {
    const auto begin = input.rows.begin() + static_cast<std::ptrdiff_t>(corner * row);
    to.insert(to.end(), begin, begin + static_cast<std::ptrdiff_t>(row));
  };

  const auto reserve_left = [&](size_t created) {
    const size_t kept = static_cast<size_t>(
        std::count(result.alive.begin(), result.alive.begin() + input_count, uint8_t{1}));
    cluster.left.triangles.reserve(created + kept);
    cluster.left.rows.reserve(3 * row * (created + kept));
  };
  if (!result.removals.empty()) {
    cluster.empty = false;
    ClusterUpdates updates;
    updates.positions = result.positions;
    updates.rows.reserve(result.vertices.size() * row);
    for (const uint32_t corner : result.first_corner) append_row(updates.rows, corner);
    updates.triangles = result.triangles;
    updates.holes = result.holes;
    updates.stars = result.stars;
    updates.consumers.resize(result.triangles.size());
    std::vector<uint32_t> heights(result.triangles.size(), 0);
    for (uint32_t t = 0; t < input_count; ++t) {
      updates.consumers[t] = {tile[t].child, tile[t].child_slot, tile[t].explicit_arc};
      heights[t] = tile[t].height;
    }
    UnitEntry& entry = cluster.entry;
    entry.error_code_min = 255;
    for (const Removal& removal : result.removals) {
      const uint8_t code = grid.ErrorCode(removal.error * model_units);
      entry.error_code_min = std::min(entry.error_code_min, code);
      entry.error_code_max = std::max(entry.error_code_max, code);
      updates.nodes.push_back({removal.vertex, removal.boundary, code, removal.hole_begin,
                               removal.hole_count, removal.star_begin, removal.star_count});
      cluster.max_degree = std::max(cluster.max_degree, removal.star_count + removal.boundary);
      uint32_t height = 0;
      for (uint32_t j = 0; j < removal.star_count; ++j) {
        const uint32_t t = result.stars[removal.star_begin + j];
        height = std::max(height, heights[t]);
        for (const uint32_t v : result.triangles[t]) entry.bounds.Add(result.positions[v]);
      }
      for (uint32_t j = 0; j < removal.hole_count; ++j) {
        heights[result.holes[removal.hole_begin + j]] = height + 1;
      }
      cluster.height = std::max(cluster.height, height + 1);
    }
    cluster.encoded = EncodeCluster(updates, attributes);
    Bytes().swap(updates.rows);  // a tile's rows are much of what a build keeps in memory
    entry.nodes = static_cast<uint32_t>(updates.nodes.size());
    entry.in_triangles = static_cast<uint32_t>(cluster.encoded.in_triangles.size());
    entry.out_triangles = cluster.encoded.out_triangles;
    entry.external_vertices = cluster.encoded.external_vertices;
    entry.explicit_arcs = cluster.encoded.explicit_arcs;

    reserve_left(cluster.encoded.in_triangles.size());
    // Created triangles that stayed: this cluster's in-triangles.
    for (uint32_t slot = 0; slot < cluster.encoded.in_triangles.size(); ++slot) {
      const uint32_t t = cluster.encoded.in_triangles[slot];
      const uint32_t rotation = cluster.encoded.in_rotations[slot];
      TileTriangle& out = cluster.left.triangles.emplace_back();
      for (uint32_t c = 0; c < 3; ++c) {
        const uint32_t from = (c + rotation) % 3;
        const uint32_t v = result.triangles[t][from];
        out.vertices[c] = result.vertices[v];
        out.positions[c] = result.positions[v];
        out.border_edges |= static_cast<uint8_t>((result.border_edges[t] >> from & 1) << c);
        out.fixed_corners |= static_cast<uint8_t>(result.fixed[v] << c);
        append_row(cluster.left.rows, result.first_corner[v]);
      }
      out.error = result.errors[t];
      out.child = TileCluster::kOwnCluster;
      out.child_slot = slot;
      out.height = heights[t];
      out.explicit_arc = cluster.encoded.explicit_arcs;
    }
  }
  if (cluster.empty) reserve_left(0);
  for (uint32_t t = 0; t < input_count; ++t) {
    if (!result.alive[t]) continue;
    cluster.left.triangles.push_back(tile[t]);
    for (uint32_t c = 0; c < 3; ++c) append_row(cluster.left.rows, 3 * t + c);
  }
  return cluster;
}

}  // namespace mtdb
