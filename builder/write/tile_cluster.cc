// SPDX-License-Identifier: Apache-2.0
#include "builder/write/tile_cluster.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace mtdb::internal {

namespace {

// How rows of corners are made up.
struct RowParts {
  size_t vertex = 0;  // bytes of the vertex's row
  std::optional<TileTexture> texture;
  size_t whole() const { return vertex + (texture ? sizeof(TextureCorner) : 0); }
};

// The first `size` bytes of a corner's row, of `whole` bytes.
void AppendRow(const Bytes& rows, size_t whole, size_t size, uint64_t corner, Bytes& to) {
  const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(corner * whole);
  to.insert(to.end(), begin, begin + static_cast<std::ptrdiff_t>(size));
}

// Of TileResult::edge_orders.
bool IsTwoSided(uint16_t orders) { return (orders & TileTriangle::kTwoSided) != 0; }

// The removals of a tile, read backwards. Leaves nodes and what the tile's own triangles say out.
ClusterUpdates UpdatesOf(const TriangleBlock& input, const TileResult& result,
                         const RowParts& row) {
  ClusterUpdates updates;
  updates.positions = result.positions;
  updates.rows.reserve(result.vertices.size() * row.vertex);
  for (const uint32_t corner : result.first_corner) {
    AppendRow(input.rows, row.whole(), row.vertex, corner, updates.rows);
  }
  if (row.texture) {
    updates.corner_step = row.texture->step;
    for (size_t t = 0; t < result.triangles.size(); ++t) {
      auto& corners = updates.corners.emplace_back();
      uint32_t seams = 0;
      for (uint32_t c = 0; c < 3; ++c) {
        corners[c] = input.texture(result.first_corner[result.triangles[t][c]], row.whole());
        seams |= ((result.edge_orders[t] >> 4 * c & 15u) == 2 ? 1u : 0u) << c;
      }
      updates.seams.push_back(static_cast<uint8_t>(seams));
    }
  }
  updates.triangles = result.triangles;
  for (std::array<uint32_t, 3>& corners : updates.triangles) {
    for (uint32_t& v : corners) v = result.first_twins[v];
  }
  if (std::ranges::any_of(result.edge_orders, IsTwoSided)) {
    updates.two_sided.resize(result.triangles.size());
    std::ranges::transform(result.edge_orders, updates.two_sided.begin(), IsTwoSided);
  }
  updates.holes = result.holes;
  updates.stars = result.stars;
  updates.consumers.resize(result.triangles.size());
  for (size_t t = 0; t < input.triangles.size(); ++t) {
    const TileTriangle& own = input.triangles[t];
    updates.consumers[t] = {own.child, own.child_slot, own.explicit_arc()};
  }
  return updates;
}

// A vertex that stands for `seat`; kNone32: none of them does.
using Places = std::vector<std::pair<uint32_t, uint32_t>>;  // seats, local vertices
uint32_t Find(const Places& places, uint32_t seat) {
  const auto at = std::ranges::find(places, seat, &Places::value_type::first);
  return at == places.end() ? kNone32 : at->second;
}

// Adds a crumb to `updates`, but for its error. Returns where its vertices and its triggers' are.
Places AddCrumb(const TriangleBlock& input, const Crumb& crumb, const TileResult& result,
                const RowParts& row, ClusterUpdates& updates) {
  ClusterUpdates::Crumb& out = updates.crumbs.emplace_back();
  out.triggers = crumb.triggers;
  Places places;
  for (const uint32_t t : crumb.triggers) {
    for (uint32_t c = 0; c < 3; ++c) {
      const uint32_t seat = input.triangles[t].seat(c);
      const uint32_t vertex = result.first_twins[result.triangles[t][c]];
      if (Find(places, seat) == kNone32) places.emplace_back(seat, vertex);
    }
  }
  for (size_t i = 0; i < crumb.triangles.size(); ++i) {
    const TileTriangle& triangle = crumb.triangles[i];
    out.triangles.push_back(static_cast<uint32_t>(updates.triangles.size()));
    std::array<uint32_t, 3>& corners = updates.triangles.emplace_back();
    for (uint32_t c = 0; c < 3; ++c) {
      corners[c] = Find(places, triangle.seat(c));
      if (corners[c] != kNone32) continue;
      corners[c] = static_cast<uint32_t>(updates.positions.size());
      places.emplace_back(triangle.seat(c), corners[c]);
      out.vertices.push_back(corners[c]);
      updates.positions.push_back(triangle.positions[c]);
      AppendRow(crumb.rows, row.whole(), row.vertex, 3 * i + c, updates.rows);
    }
    updates.consumers.push_back({triangle.child, triangle.child_slot, triangle.explicit_arc()});
    if (triangle.two_sided() || !updates.two_sided.empty()) {
      updates.two_sided.resize(updates.triangles.size());
      updates.two_sided.back() = triangle.two_sided();
    }
  }
  return places;
}

// Work units: below this an error is 0 that was computed from the tile's coordinates in binary64
// (docs/design.md, section 3, "Rounding").
double ArithmeticNoise(const TileResult& result, const Grid& grid) {
  constexpr int kNoiseBits = 44;  // of 53
  double largest = 0;
  for (const Vec3i& p : result.positions) {
    const Vec3d at = grid.is_linear() ? ToDouble(p) : grid.Position(p);
    largest = std::max({largest, std::abs(at.x), std::abs(at.y), std::abs(at.z)});
  }
  return std::ldexp(largest, -kNoiseBits);
}

// How many vertices lie around the holes that a removal leaves.
uint32_t DegreeOf(const Removal& removal, std::span<const uint32_t> star,
                  const ClusterUpdates& updates) {
  if (removal.fans < 2) return removal.star_count + removal.fans;
  std::vector<uint32_t> around;
  for (const uint32_t t : star) {
    around.insert(around.end(), updates.triangles[t].begin(), updates.triangles[t].end());
  }
  std::sort(around.begin(), around.end());
  return static_cast<uint32_t>(std::unique(around.begin(), around.end()) - around.begin()) - 1;
}

// Adds the nodes to `updates`, and to `cluster` what their entry in the index and the object's
// record need. `heights`: of the tile's triangles; gets those of all.
void AddNodes(const TileResult& result, const Grid& grid, ClusterUpdates& updates,
              std::vector<uint32_t>& heights, TileCluster& cluster) {
  const double model_units = grid.is_linear() ? grid.step : 1.0;
  const double noise = ArithmeticNoise(result, grid);
  UnitEntry& entry = cluster.entry;
  entry.error_code_min = 255;
  heights.resize(result.triangles.size(), 0);
  for (const Removal& removal : result.removals) {
    const double error = removal.error > noise ? removal.error : 0;
    const uint8_t code = grid.ErrorCode(error * model_units);
    entry.error_code_min = std::min(entry.error_code_min, code);
    entry.error_code_max = std::max(entry.error_code_max, code);
    updates.nodes.push_back({removal.vertex, code, removal.hole_begin, removal.hole_count,
                             removal.star_begin, removal.star_count, removal.fans});
    cluster.max_degree = std::max(
        cluster.max_degree, DegreeOf(removal, updates.star(updates.nodes.size() - 1), updates));
    uint32_t height = 0;
    for (const uint32_t t : updates.star(updates.nodes.size() - 1)) {
      height = std::max(height, heights[t]);
      for (const uint32_t v : result.triangles[t]) entry.bounds.Add(result.positions[v]);
    }
    for (const uint32_t t : updates.hole(updates.nodes.size() - 1)) heights[t] = height + 1;
    cluster.height = std::max(cluster.height, height + 1);
  }
}

// Likewise of crumbs. The first that vanished is the finest.
void AddCrumbs(const TriangleBlock& input, std::span<const Crumb> crumbs, const TileResult& result,
               const Grid& grid, const RowParts& row, ClusterUpdates& updates,
               TileCluster& cluster) {
  const double model_units = grid.is_linear() ? grid.step : 1.0;
  const double noise = ArithmeticNoise(result, grid);
  UnitEntry& entry = cluster.entry;
  for (size_t i = crumbs.size(); i-- > 0;) {
    const Crumb& crumb = crumbs[i];
    const Places places = AddCrumb(input, crumb, result, row, updates);
    ClusterUpdates::Crumb& out = updates.crumbs.back();
    out.error_code = grid.ErrorCode((crumb.error > noise ? crumb.error : 0) * model_units);
    entry.error_code_min = std::min(entry.error_code_min, out.error_code);
    entry.error_code_max = std::max(entry.error_code_max, out.error_code);
    for (const auto& [seat, vertex] : places) entry.bounds.Add(updates.positions[vertex]);
    const size_t around = places.size() - out.vertices.size();
    cluster.max_degree = std::max(cluster.max_degree, static_cast<uint32_t>(around));
    cluster.height = std::max(cluster.height, crumb.height);
  }
  if (!updates.two_sided.empty()) updates.two_sided.resize(updates.triangles.size());
}

// Adds the opposites of two-sided triangles to what the entry counts.
void CountOtherSides(const ClusterUpdates& updates, const EncodedCluster& encoded,
                     UnitEntry& entry) {
  if (updates.two_sided.empty()) return;
  std::vector<uint8_t> removed(updates.triangles.size());
  for (const uint32_t t : updates.holes) removed[t] = 1;
  for (const uint32_t t : encoded.in_triangles) {
    entry.in_triangles += updates.two_sided[t];
    if (!removed[t]) entry.out_triangles += updates.two_sided[t];
  }
  for (const uint32_t t : updates.stars) {
    if (!removed[t]) entry.out_triangles += updates.two_sided[t];
  }
  for (const ClusterUpdates::Crumb& crumb : updates.crumbs) {
    for (const uint32_t t : crumb.triangles) entry.out_triangles += updates.two_sided[t];
  }
}

// Appends the cluster's in-triangles to what is left: created ones that stayed, and triggers.
void LeaveInTriangles(const TriangleBlock& input, const TileResult& result, size_t row,
                      std::span<const uint32_t> heights, TileCluster& cluster) {
  const EncodedCluster& encoded = cluster.encoded;
  for (uint32_t slot = 0; slot < encoded.in_triangles.size(); ++slot) {
    const uint32_t t = encoded.in_triangles[slot];
    TileTriangle& out = cluster.left.triangles.emplace_back();
    for (uint32_t c = 0; c < 3; ++c) {
      const uint32_t from = (c + encoded.in_rotations[slot]) % 3;
      const uint32_t v = result.triangles[t][from];
      out.vertices[c] = result.vertices[v];
      out.positions[c] = result.positions[v];
      out.set_order(c, result.edge_orders[t] >> 4 * from & 15u);
      out.set_fixed(c, result.fixed[v] != 0);
      out.set_fan(c, result.fans[v]);
      out.set_more_fans(c, result.more_fans[v] != 0);
      AppendRow(input.rows, row, row, result.first_corner[v], cluster.left.rows);
    }
    out.set_two_sided(IsTwoSided(result.edge_orders[t]));
    out.error = result.errors[t];
    out.child = TileCluster::kOwnCluster;
    out.child_slot = slot;
    out.height = heights[t];
    out.set_explicit_arc(encoded.explicit_arcs);
  }
}

// Appends what `surface` says of the cluster's in-triangles, and finds their slots by the tile's
// numbers (kNone32: not one of them). Marks their vertices in `wanted`. `own`: of the tile's, those
// that are triangles of the surface.
void AddInTriangles(const TileResult& result, const EncodedCluster& encoded,
                    std::span<const uint8_t> own, TileSurface& surface,
                    std::vector<uint32_t>& slots, std::vector<uint8_t>& wanted) {
  slots.assign(result.triangles.size(), kNone32);
  for (uint32_t slot = 0; slot < encoded.in_triangles.size(); ++slot) {
    const uint32_t t = encoded.in_triangles[slot];
    const uint32_t turn = encoded.in_rotations[slot];
    slots[t] = slot;
    for (const uint32_t v : result.triangles[t]) wanted[v] = 1;
    surface.own.push_back(t < own.size() && own[t] != 0);
    auto& errors = surface.edge_errors.emplace_back();
    for (uint32_t c = 0; c < 3; ++c) errors[c] = result.edge_errors[3 * t + (c + turn) % 3];
  }
}

// Appends the removed vertices and the paths on the cluster's in-triangles, and marks the vertices
// in `wanted`. What is on others is left by the clusters that made them.
template <typename PlaceOf>
void AddWhatTheyStandFor(const TileResult& result, const EncodedCluster& encoded,
                         std::span<const uint32_t> slots, const PlaceOf& place_of,
                         TileSurface& surface, std::vector<uint8_t>& wanted) {
  const auto turned = [&](uint32_t slot, uint32_t side) {
    return side == 3 ? 3 : (side + 3 - encoded.in_rotations[slot]) % 3;
  };
  for (const auto& [vertex, triangle, edge] : result.held) {
    const uint32_t slot = slots[triangle];
    if (slot == kNone32) continue;
    wanted[vertex] = 1;
    surface.held.push_back({place_of(vertex), slot, turned(slot, edge)});
  }
  for (const Chord& chord : result.chords) {
    const uint32_t slot = slots[chord.triangle];
    if (slot == kNone32) continue;
    const auto enters = static_cast<uint8_t>(turned(slot, chord.enters));
    const auto leaves = static_cast<uint8_t>(turned(slot, chord.leaves));
    surface.chords.push_back(
        {place_of(chord.from), place_of(chord.to), chord.error, slot, enters, leaves});
  }
}

// The surface that the tile was measured against, as far as it lies beneath the cluster's
// in-triangles, and what of it they stand for.
TileSurface LeftSurface(const TriangleBlock& input, const TileResult& result,
                        const EncodedCluster& encoded, const RowParts& row,
                        const MeasuredAgainst& against) {
  if (against.round == 0) return {};
  const TileSurface* beneath = against.surface;
  TileSurface surface;
  surface.round = against.round;
  // By local number, that of the tile's vertices and then of others beneath it.
  std::vector<uint32_t> numbers = result.vertices;
  std::vector<Vec3i> positions = result.positions;
  std::vector<TextureCorner> corners;
  if (row.texture) {
    for (const uint32_t corner : result.first_corner) {
      corners.push_back(input.texture(corner, row.whole()));
    }
  }
  std::vector<uint32_t> local;
  if (beneath != nullptr) {
    local = NumberVertices(*beneath, result.vertices);
    for (size_t v = 0; v < local.size(); ++v) {
      if (local[v] < numbers.size()) continue;
      numbers.push_back(beneath->vertices[v]);
      positions.push_back(beneath->positions[v]);
      if (row.texture) corners.push_back(beneath->corners[v]);
    }
  }
  std::vector<uint32_t> places(numbers.size(), kNone32);
  const auto place_of = [&](uint32_t v) {
    if (places[v] == kNone32) {
      places[v] = static_cast<uint32_t>(surface.vertices.size());
      surface.vertices.push_back(numbers[v]);
      surface.positions.push_back(positions[v]);
      if (row.texture) surface.corners.push_back(corners[v]);
    }
    return places[v];
  };
  std::vector<uint8_t> wanted(numbers.size());
  std::vector<uint32_t> slots;
  const std::vector<uint8_t> own =
      beneath == nullptr ? std::vector<uint8_t>(input.triangles.size(), 1) : beneath->own;
  AddInTriangles(result, encoded, own, surface, slots, wanted);
  AddWhatTheyStandFor(result, encoded, slots, place_of, surface, wanted);
  const auto add = [&](uint32_t a, uint32_t b, uint32_t c, float error) {
    if (!wanted[a] && !wanted[b] && !wanted[c]) return;
    surface.triangles.push_back({place_of(a), place_of(b), place_of(c)});
    surface.errors.push_back(error);
  };
  for (uint32_t t = 0; t < input.triangles.size(); ++t) {
    if (result.alive[t] || !own[t]) continue;
    const auto [a, b, c] = result.triangles[t];
    add(a, b, c, input.triangles[t].error);
  }
  if (beneath == nullptr) return surface;
  for (size_t t = 0; t < beneath->triangles.size(); ++t) {
    const auto [a, b, c] = beneath->triangles[t];
    add(local[a], local[b], local[c], beneath->errors[t]);
  }
  return surface;
}

}  // namespace

TileCluster MakeTileCluster(const TriangleBlock& input, std::span<const Crumb> crumbs,
                            const TileResult& result, const Grid& grid,
                            const AttributeLayout& attributes,
                            const std::optional<TileTexture>& texture,
                            const MeasuredAgainst& against) {
  TileCluster cluster;
  const std::vector<TileTriangle>& tile = input.triangles;
  const RowParts parts{attributes.row_bytes(), texture};
  const size_t row = parts.whole();
  std::vector<uint32_t> heights;
  if (!result.removals.empty() || !crumbs.empty()) {
    cluster.empty = false;
    ClusterUpdates updates = UpdatesOf(input, result, parts);
    updates.is_height_field = grid.mode == PositionMode::kRaster;
    heights.reserve(result.triangles.size());
    for (const TileTriangle& t : tile) heights.push_back(t.height);
    AddNodes(result, grid, updates, heights, cluster);
    AddCrumbs(input, crumbs, result, grid, parts, updates, cluster);
    cluster.encoded = EncodeCluster(updates, attributes);
    Bytes().swap(updates.rows);  // a tile's rows are much of what a build keeps in memory
    UnitEntry& entry = cluster.entry;
    entry.nodes = cluster.encoded.nodes;
    entry.in_triangles = static_cast<uint32_t>(cluster.encoded.in_triangles.size());
    entry.out_triangles = cluster.encoded.out_triangles;
    CountOtherSides(updates, cluster.encoded, entry);
    entry.external_vertices = cluster.encoded.external_vertices;
    entry.explicit_arcs = cluster.encoded.explicit_arcs;
    if (!result.edge_errors.empty()) {
      cluster.surface =
          EncodeTileSurface(LeftSurface(input, result, cluster.encoded, parts, against));
    }
  }
  std::vector<uint8_t> kept(result.alive.begin(),
                            result.alive.begin() + static_cast<std::ptrdiff_t>(tile.size()));
  for (const uint32_t t : cluster.encoded.in_triangles) {
    if (t < tile.size()) kept[t] = 0;
  }
  const auto kept_count = static_cast<size_t>(std::ranges::count(kept, uint8_t{1}));
  const size_t left = cluster.encoded.in_triangles.size() + kept_count;
  cluster.left.triangles.reserve(left);
  cluster.left.rows.reserve(3 * row * left);
  LeaveInTriangles(input, result, row, heights, cluster);
  for (uint32_t t = 0; t < tile.size(); ++t) {
    if (!kept[t]) continue;
    cluster.left.triangles.push_back(tile[t]);
    for (uint32_t c = 0; c < 3; ++c) AppendRow(input.rows, row, row, 3 * t + c, cluster.left.rows);
  }
  return cluster;
}

}  // namespace mtdb::internal
