// SPDX-License-Identifier: Apache-2.0
#include "builder/holes/tile_mesh.h"

#include <algorithm>
#include <utility>

#include "builder/disk/number_table.h"

namespace mtdb::internal {

void PairHalfEdges(std::span<const std::array<uint32_t, 3>> triangles, uint32_t vertex_count,
                   std::vector<uint32_t>& opposite) {
  // Buckets by smaller end, and in each by the other one: a vertex may have any number of edges.
  struct Use {
    uint32_t larger;
    uint32_t half_edge : 31;
    uint32_t forward : 1;  // from the smaller end to the larger
  };
  const auto n = static_cast<uint32_t>(3 * triangles.size());
  opposite.assign(n, kNone32);
  std::vector<uint32_t> begin(vertex_count + 1, 0);
  for (const auto& t : triangles) {
    for (size_t c = 0; c < 3; ++c) ++begin[std::min(t[c], t[c == 2 ? 0 : c + 1]) + 1];
  }
  for (uint32_t v = 0; v < vertex_count; ++v) begin[v + 1] += begin[v];
  std::vector<Use> uses(n);
  std::vector<uint32_t> at(begin.begin(), begin.end() - 1);
  uint32_t h = 0;
  for (const auto& t : triangles) {
    for (size_t c = 0; c < 3; ++c, ++h) {
      const uint32_t a = t[c];
      const uint32_t b = t[c == 2 ? 0 : c + 1];
      uses[at[std::min(a, b)]++] = {std::max(a, b), h & 0x7fffffff, a < b};
    }
  }
  for (uint32_t v = 0; v < vertex_count; ++v) {
    const auto bucket = std::span(uses).subspan(begin[v], begin[v + 1] - begin[v]);
    std::sort(bucket.begin(), bucket.end(),
              [](const Use& a, const Use& b) { return a.larger < b.larger; });
    for (size_t i = 0, end = 0; i < bucket.size(); i = end) {
      while (end < bucket.size() && bucket[end].larger == bucket[i].larger) ++end;
      if (end != i + 2 || bucket[i].forward == bucket[i + 1].forward) continue;
      opposite[bucket[i].half_edge] = bucket[i + 1].half_edge;
      opposite[bucket[i + 1].half_edge] = bucket[i].half_edge;
    }
  }
}

void TileMesh::NumberVertices(std::span<const TileTriangle> tile) {
  NumberTable numbers(tile.size());  // a closed surface has half as many
  vertices_.clear();
  first_corner_.clear();
  grid_positions_.clear();
  fixed_.clear();
  fans_.clear();
  more_fans_.clear();
  has_twins_ = false;
  input_corners_.resize(tile.size());
  for (uint32_t t = 0; t < tile.size(); ++t) {
    for (uint32_t c = 0; c < 3; ++c) {
      has_twins_ |= tile[t].fan(c) != 0 || tile[t].order(c) > 1;
      const uint32_t v = tile[t].vertices[c];
      const auto [number, fresh] = numbers.Add(v, vertices());
      if (fresh) {
        vertices_.push_back(v);
        first_corner_.push_back(3 * t + c);
        grid_positions_.push_back(tile[t].positions[c]);
        fixed_.push_back(0);
        fans_.push_back(static_cast<uint8_t>(tile[t].fan(c)));
        more_fans_.push_back(tile[t].more_fans(c));
      }
      input_corners_[t][c] = number;
      fixed_[number] |= static_cast<uint8_t>(tile[t].fixed(c));
    }
  }
}

void TileMesh::Load(std::span<const TileTriangle> tile, const Grid& grid, bool is_height_field,
                    bool has_crumbs) {
  is_height_field_ = is_height_field;
  NumberVertices(tile);
  const auto n = static_cast<uint32_t>(tile.size());
  places_.assign(vertices(), Place{});
  for (uint32_t v = 0; v < vertices(); ++v) {
    places_[v].position =
        grid.is_linear() ? ToDouble(grid_positions_[v]) : grid.Position(grid_positions_[v]);
    places_[v].locked = fixed_[v];
    places_[v].outside = fans_[v] != 0 || more_fans_[v] != 0;
    places_[v].twin = places_[v].first_twin = v;
  }
  PairHalfEdges(input_corners_, vertices(), input_opposites_);
  constexpr uint16_t kKept = 0xfff | TileTriangle::kTwoSided;
  triangles_.clear();
  two_sided_ = 0;
  for (uint32_t t = 0; t < n; ++t) {
    two_sided_ += tile[t].two_sided();
    uint32_t* const across = &input_opposites_[3 * size_t{t}];
    for (uint32_t i = 0; i < 3; ++i) {
      // Two of several triangles at a crease may look like all that there are.
      if (tile[t].order(i) > 1) across[i] = kNone32;
    }
    triangles_.push_back({input_corners_[t],
                          {across[0], across[1], across[2]},
                          static_cast<uint16_t>(tile[t].edges & kKept)});
  }
  for (uint32_t h = 0; h < 3 * n; ++h) {
    Place& a = places_[Origin(h)];
    Place& b = places_[Origin(Next(h))];
    if (opposite(h) == kNone32) {
      if (const uint32_t order = triangles_[h / 3].order(h % 3); order != 0) {
        a.order = b.order = static_cast<uint8_t>(order);
        a.half_edge = h;
      } else {
        a.locked = b.locked = a.outside = b.outside = true;
      }
    }
    if (a.half_edge == kNone32) a.half_edge = h;
  }
  if (has_twins_) FindTwins(tile);
  if (has_crumbs) {
    for (Place& place : places_) place.outside = place.locked;
  }
  ring_mark_.assign(vertices(), 0);
  holes_.clear();
  stars_.clear();
  live_triangles_ = n;
}

// A vertex on a chain can go when all its fans are here as a whole.
void TileMesh::FindTwins(std::span<const TileTriangle> tile) {
  std::vector<uint8_t> open(vertices());  // of vertices: a triangle of their fan is elsewhere
  for (uint32_t h = 0; h < 3 * tile.size(); ++h) {
    if (opposite(h) != kNone32 || order(h) != 0) continue;
    open[Origin(h)] = open[Origin(Next(h))] = 1;
  }
  std::vector<std::pair<uint32_t, uint32_t>> fans;  // the first one's number, the vertex here
  for (uint32_t v = 0; v < vertices(); ++v) {
    const uint32_t corner = first_corner_[v];
    fans.emplace_back(tile[corner / 3].seat(corner % 3), v);
  }
  std::sort(fans.begin(), fans.end(), [&](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : vertices_[a.second] < vertices_[b.second];
  });
  for (size_t begin = 0, end = 0; begin < fans.size(); begin = end) {
    bool locked = false;
    bool outside = false;
    uint32_t order = 1;
    for (; end < fans.size() && fans[end].first == fans[begin].first; ++end) {
      const uint32_t v = fans[end].second;
      locked |= places_[v].locked;
      outside |= open[v] != 0 || fans_[v] != end - begin;
      order = std::max<uint32_t>(order, places_[v].order);
    }
    locked |= end - begin != order;
    outside |= more_fans_[fans[end - 1].second] != 0;
    for (size_t i = begin; i < end; ++i) {
      Place& place = places_[fans[i].second];
      place.locked = locked;
      place.outside = outside;
      place.twin = fans[i + 1 == end ? begin : i + 1].second;
      place.first_twin = fans[begin].second;
    }
  }
}

bool TileMesh::OpenHole(uint32_t v, uint32_t limit, Hole& hole) const {
  hole.ring.clear();
  hole.star.clear();
  hole.ring_edges.clear();
  const uint32_t first = places_[v].half_edge;
  uint32_t h = first;
  do {
    if (hole.ring.size() >= limit) return false;
    hole.ring.push_back(Origin(Next(h)));
    hole.star.push_back(h / 3);
    hole.ring_edges.push_back(Next(h));
    const uint32_t last = Previous(h);
    h = opposite(last);
    if (h == kNone32) {  // the far end of a border vertex's fan
      if (hole.ring.size() >= limit) return false;
      hole.ring.push_back(Origin(last));
      hole.border_in = last;
      break;
    }
  } while (h != first);
  hole.vertex = v;
  hole.k = static_cast<uint32_t>(hole.ring.size());
  hole.boundary = places_[v].order != 0;
  hole.border_out = first;
  hole.folded = false;
  hole.flat = is_height_field_;
  hole.apex = places_[v].position;
  for (uint32_t i = 0; i < hole.k; ++i) hole.positions[i] = places_[hole.ring[i]].position;
  return true;
}

template <typename F>
bool TileMesh::AnyNeighbour(uint32_t v, F&& f) const {
  const uint32_t first = places_[v].half_edge;
  uint32_t h = first;
  do {
    if (f(Origin(Next(h)))) return true;
    const uint32_t last = Previous(h);
    h = opposite(last);
    if (h == kNone32) return f(Origin(last));
  } while (h != first);
  return false;
}

// Every edge with an end that is here as a whole is in a fan of that end.
bool TileMesh::AreAdjacent(uint32_t whole, uint32_t other) const {
  const uint32_t wanted = first_twin(other);
  uint32_t v = whole;
  do {
    if (AnyNeighbour(v, [&](uint32_t w) { return first_twin(w) == wanted; })) return true;
    v = twin(v);
  } while (v != whole);
  return false;
}

bool TileMesh::EdgesAreFree(const Hole& hole) const {
  const uint32_t k = hole.k;
  const std::vector<uint32_t>& ring = hole.ring;
  if (k < 3) return false;
  if (hole.flat) return true;
  // A triangle all of whose edges are creases may be one of another sheet, too.
  if (k == 3 && places_[hole.vertex].order != 1 &&
      std::ranges::all_of(hole.ring_edges, [&](uint32_t h) { return order(h) > 1; })) {
    return false;
  }
  if (hole.boundary) {
    const uint32_t a = ring[0];
    const uint32_t b = ring[k - 1];
    return outside(a) ? !outside(b) && !AreAdjacent(b, a) : !AreAdjacent(a, b);
  }
  if (k > 3) return true;
  if (outside(ring[0]) && outside(ring[1]) && outside(ring[2])) return false;
  for (uint32_t i = 0; i < 3; ++i) {
    const uint32_t o = opposite(hole.ring_edges[i]);
    if (o != kNone32 && first_twin(Origin(Previous(o))) == first_twin(ring[(i + 2) % 3])) {
      return false;
    }
  }
  return true;
}

void TileMesh::ForbidEdges(Hole& hole, bool existing) {
  const uint32_t k = hole.k;
  const std::vector<uint32_t>& ring = hole.ring;
  if (hole.flat) {
    for (auto& row : hole.forbidden) row.fill(0);
    return;
  }
  for (uint32_t i = 0; i < k; ++i) {
    for (uint32_t j = 0; j < k; ++j) {
      hole.forbidden[i][j] = outside(ring[i]) && outside(ring[j]);
    }
  }
  if (!existing) return;
  // As AreAdjacent.
  for (uint32_t i = 0; i < k; ++i) ring_mark_[first_twin(ring[i])] = i + 1;
  for (uint32_t i = 0; i < k; ++i) {
    if (outside(ring[i])) continue;
    uint32_t v = ring[i];
    do {
      AnyNeighbour(v, [&](uint32_t w) {
        if (const uint32_t j = ring_mark_[first_twin(w)]; j != 0) {
          hole.forbidden[i][j - 1] = hole.forbidden[j - 1][i] = 1;
        }
        return false;
      });
      v = twin(v);
    } while (v != ring[i]);
  }
  for (uint32_t i = 0; i < k; ++i) ring_mark_[first_twin(ring[i])] = 0;
}

bool TileMesh::UsesExistingEdge(const Hole& hole, const Hole::Triangles& triangles) const {
  if (hole.flat) return false;
  for (uint32_t t = 1; t < hole.k - 2; ++t) {
    const uint32_t a = hole.ring[triangles[t][0]];
    const uint32_t b = hole.ring[triangles[t][2]];
    if (outside(a) ? AreAdjacent(b, a) : AreAdjacent(a, b)) return true;
  }
  return false;
}

Removal TileMesh::Fill(const Hole& hole, const Hole::Triangles& triangles) {
  Removal removal;
  removal.vertex = hole.vertex;
  removal.fans = places_[hole.vertex].order;
  removal.star_begin = static_cast<uint32_t>(stars_.size());
  removal.hole_begin = static_cast<uint32_t>(holes_.size());
  Fill(hole, triangles, removal);
  return removal;
}

void TileMesh::Fill(const Hole& hole, const Hole::Triangles& triangles, Removal& removal) {
  const uint32_t count = hole.k - 2;
  const uint32_t first = this->triangles();
  removal.star_count += static_cast<uint32_t>(hole.star.size());
  removal.hole_count += count;
  for (const uint32_t t : hole.star) {
    triangles_[t].alive = false;
    stars_.push_back(t);
  }
  const uint16_t two_sided = triangles_[hole.star[0]].orders & TileTriangle::kTwoSided;
  for (uint32_t t = 0; t < count; ++t) {
    const auto [i, m, j] = triangles[t];
    triangles_.push_back(
        {.corners = {hole.ring[i], hole.ring[m], hole.ring[j]}, .orders = two_sided});
    holes_.push_back(first + t);
  }
  if (two_sided != 0) two_sided_ += count;
  LinkFilling(hole, triangles, first);
  places_[hole.vertex].removed = true;
  live_triangles_ -= static_cast<uint32_t>(hole.star.size()) - count;
}

// Pairs the half-edges of the filling, among themselves and with what lies around the hole.
void TileMesh::LinkFilling(const Hole& hole, const Hole::Triangles& triangles, uint32_t first) {
  const uint32_t count = hole.k - 2;
  Hole::PerEdge<uint32_t> diagonal;  // [a][b]: half-edge from a to b
  for (uint32_t t = 0; t < count; ++t) {
    const uint32_t id = first + t;
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [a, b] = Hole::Edge(triangles[t], c);
      const uint32_t h = 3 * id + c;
      if (hole.OnRing(a, b)) {
        const uint32_t old = hole.ring_edges[a];
        const uint32_t beyond = opposite(old);
        opposite(h) = beyond;
        if (beyond != kNone32) opposite(beyond) = h;
        triangles_[id].orders |= static_cast<uint16_t>(triangles_[old / 3].order(old % 3) << 4 * c);
      } else if (hole.IsNewBorder(a, b)) {
        triangles_[id].orders |= static_cast<uint16_t>(places_[hole.vertex].order << 4 * c);
      } else {
        diagonal[a][b] = h;
      }
    }
  }
  for (uint32_t t = 1; t < count; ++t) {  // each hangs on the diagonal (i, j)
    const auto [i, m, j] = triangles[t];
    opposite(diagonal[i][j]) = diagonal[j][i];
    opposite(diagonal[j][i]) = diagonal[i][j];
  }
  // Outgoing half-edges of the ring; a border vertex keeps the one on the border.
  for (uint32_t h = 3 * first; h < 3 * (first + count); ++h) {
    const uint32_t a = Origin(h);
    if (!triangles_[places_[a].half_edge / 3].alive) places_[a].half_edge = h;
  }
  for (uint32_t h = 3 * first; h < 3 * (first + count); ++h) {
    if (opposite(h) == kNone32) places_[Origin(h)].half_edge = h;
  }
}

void TileMesh::CopyTo(TileResult& result) const {
  result.vertices = vertices_;
  result.first_corner = first_corner_;
  result.positions = grid_positions_;
  result.triangles.reserve(triangles());
  result.edge_orders.reserve(triangles());
  result.alive.reserve(triangles());
  for (const Triangle& t : triangles_) {
    result.triangles.push_back(t.corners);
    result.edge_orders.push_back(t.orders);
    result.alive.push_back(t.alive);
  }
  result.fixed = fixed_;
  result.fans = fans_;
  result.more_fans = more_fans_;
  result.first_twins.reserve(vertices());
  for (const Place& place : places_) result.first_twins.push_back(place.first_twin);
  result.holes = holes_;
  result.stars = stars_;
}

}  // namespace mtdb::internal
