// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/tile_mesh.h"

#include <algorithm>
#include <bit>
#include <utility>

namespace mtdb::internal {

void PairHalfEdges(std::span<const std::array<uint32_t, 3>> triangles, uint32_t vertex_count,
                   std::vector<uint32_t>& opposite) {
  // Buckets by smaller end; within a bucket (a handful of edges) all pairs are compared.
  struct Use {
    uint32_t larger;
    uint32_t half_edge;
    bool forward;  // from the smaller end to the larger
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
      uses[at[std::min(a, b)]++] = {std::max(a, b), h, a < b};
    }
  }
  for (uint32_t v = 0; v < vertex_count; ++v) {
    const auto bucket = std::span(uses).subspan(begin[v], begin[v + 1] - begin[v]);
    for (const Use& use : bucket) {
      uint32_t twin = kNone32;
      int forward = 0;
      int backward = 0;
      for (const Use& other : bucket) {
        if (other.larger != use.larger) continue;
        if (other.forward == use.forward) {
          ++forward;
        } else {
          ++backward;
          twin = other.half_edge;
        }
      }
      if (forward == 1 && backward == 1) opposite[use.half_edge] = twin;
    }
  }
}

void TileMesh::NumberVertices(std::span<const TileTriangle> tile) {
  const size_t capacity = std::bit_ceil(6 * tile.size() + 2);
  std::vector<std::pair<uint32_t, uint32_t>> table(capacity, {kNone32, 0});
  vertices_.clear();
  first_corner_.clear();
  grid_positions_.clear();
  fixed_.clear();
  corners_.resize(tile.size());
  for (uint32_t t = 0; t < tile.size(); ++t) {
    for (uint32_t c = 0; c < 3; ++c) {
      const uint32_t v = tile[t].vertices[c];
      size_t i = (v * 0x9e3779b97f4a7c15ull >> 24) & (capacity - 1);
      while (table[i].first != kNone32 && table[i].first != v) i = (i + 1) & (capacity - 1);
      if (table[i].first == kNone32) {
        table[i] = {v, vertices()};
        vertices_.push_back(v);
        first_corner_.push_back(3 * t + c);
        grid_positions_.push_back(tile[t].positions[c]);
        fixed_.push_back(0);
      }
      corners_[t][c] = table[i].second;
      fixed_[table[i].second] |= tile[t].fixed_corners >> c & 1;
    }
  }
}

void TileMesh::Load(std::span<const TileTriangle> tile, const Grid& grid) {
  NumberVertices(tile);
  const auto n = static_cast<uint32_t>(tile.size());
  positions_.resize(vertices());
  for (uint32_t v = 0; v < vertices(); ++v) {
    positions_[v] =
        grid.is_linear() ? ToDouble(grid_positions_[v]) : grid.Position(grid_positions_[v]);
  }
  PairHalfEdges(corners_, vertices(), opposite_);
  border_.resize(n);
  for (uint32_t t = 0; t < n; ++t) border_[t] = tile[t].border_edges;
  half_edge_.assign(vertices(), kNone32);
  locked_ = fixed_;
  on_border_.assign(vertices(), 0);
  for (uint32_t h = 0; h < 3 * n; ++h) {
    const uint32_t a = Origin(h);
    const uint32_t b = Origin(Next(h));
    if (opposite_[h] == kNone32) {
      if (IsBorderEdge(h)) {
        on_border_[a] = on_border_[b] = 1;
        half_edge_[a] = h;
      } else {
        locked_[a] = locked_[b] = 1;
      }
    }
    if (half_edge_[a] == kNone32) half_edge_[a] = h;
  }
  alive_.assign(n, 1);
  removed_.assign(vertices(), 0);
  ring_mark_.assign(vertices(), 0);
  holes_.clear();
  stars_.clear();
  live_triangles_ = n;
}

bool TileMesh::OpenHole(uint32_t v, uint32_t limit, Hole& hole) const {
  hole.ring.clear();
  hole.star.clear();
  hole.ring_edges.clear();
  const uint32_t first = half_edge_[v];
  uint32_t h = first;
  do {
    if (hole.ring.size() >= limit) return false;
    hole.ring.push_back(Origin(Next(h)));
    hole.star.push_back(h / 3);
    hole.ring_edges.push_back(Next(h));
    const uint32_t last = Previous(h);
    h = opposite_[last];
    if (h == kNone32) {  // the far end of a border vertex's fan
      if (hole.ring.size() >= limit) return false;
      hole.ring.push_back(Origin(last));
      hole.border_in = last;
      break;
    }
  } while (h != first);
  hole.vertex = v;
  hole.k = static_cast<uint32_t>(hole.ring.size());
  hole.boundary = on_border_[v];
  hole.border_out = first;
  hole.folded = false;
  hole.apex = positions_[v];
  for (uint32_t i = 0; i < hole.k; ++i) hole.positions[i] = positions_[hole.ring[i]];
  return true;
}

template <typename F>
bool TileMesh::AnyNeighbour(uint32_t v, F&& f) const {
  const uint32_t first = half_edge_[v];
  uint32_t h = first;
  do {
    if (f(Origin(Next(h)))) return true;
    const uint32_t last = Previous(h);
    h = opposite_[last];
    if (h == kNone32) return f(Origin(last));
  } while (h != first);
  return false;
}

bool TileMesh::AreAdjacent(uint32_t unlocked, uint32_t other) const {
  return AnyNeighbour(unlocked, [&](uint32_t w) { return w == other; });
}

bool TileMesh::EdgesAreFree(const Hole& hole) const {
  const uint32_t k = hole.k;
  const std::vector<uint32_t>& ring = hole.ring;
  if (k < 3) return false;
  if (hole.boundary) {
    const uint32_t a = ring[0];
    const uint32_t b = ring[k - 1];
    return locked_[a] ? !locked_[b] && !AreAdjacent(b, a) : !AreAdjacent(a, b);
  }
  if (k > 3) return true;
  if (locked_[ring[0]] && locked_[ring[1]] && locked_[ring[2]]) return false;
  for (uint32_t i = 0; i < 3; ++i) {
    const uint32_t o = opposite_[hole.ring_edges[i]];
    if (o != kNone32 && Origin(Previous(o)) == ring[(i + 2) % 3]) return false;
  }
  return true;
}

void TileMesh::ForbidEdges(Hole& hole, bool existing) {
  const uint32_t k = hole.k;
  const std::vector<uint32_t>& ring = hole.ring;
  for (uint32_t i = 0; i < k; ++i) {
    for (uint32_t j = 0; j < k; ++j) {
      hole.forbidden[i][j] = locked_[ring[i]] && locked_[ring[j]];
    }
  }
  if (!existing) return;
  // Every edge with an unlocked end is in the fan of that end, which is whole.
  for (uint32_t i = 0; i < k; ++i) ring_mark_[ring[i]] = i + 1;
  for (uint32_t i = 0; i < k; ++i) {
    if (locked_[ring[i]]) continue;
    AnyNeighbour(ring[i], [&](uint32_t w) {
      if (const uint32_t j = ring_mark_[w]; j != 0) {
        hole.forbidden[i][j - 1] = hole.forbidden[j - 1][i] = 1;
      }
      return false;
    });
  }
  for (uint32_t i = 0; i < k; ++i) ring_mark_[ring[i]] = 0;
}

bool TileMesh::UsesExistingEdge(const Hole& hole, const Hole::Triangles& triangles) const {
  for (uint32_t t = 1; t < hole.k - 2; ++t) {
    const uint32_t a = hole.ring[triangles[t][0]];
    const uint32_t b = hole.ring[triangles[t][2]];
    if (locked_[a] ? AreAdjacent(b, a) : AreAdjacent(a, b)) return true;
  }
  return false;
}

Removal TileMesh::Fill(const Hole& hole, const Hole::Triangles& triangles) {
  const uint32_t count = hole.k - 2;
  const uint32_t first = this->triangles();
  Removal removal;
  removal.vertex = hole.vertex;
  removal.star_begin = static_cast<uint32_t>(stars_.size());
  removal.star_count = static_cast<uint32_t>(hole.star.size());
  removal.hole_begin = static_cast<uint32_t>(holes_.size());
  removal.hole_count = count;
  for (const uint32_t t : hole.star) {
    alive_[t] = 0;
    stars_.push_back(t);
  }
  corners_.resize(first + count);
  border_.resize(first + count, 0);
  alive_.resize(first + count, 1);
  opposite_.resize(3 * (first + count), kNone32);
  for (uint32_t t = 0; t < count; ++t) {
    const auto [i, m, j] = triangles[t];
    corners_[first + t] = {hole.ring[i], hole.ring[m], hole.ring[j]};
    holes_.push_back(first + t);
  }
  LinkFilling(hole, triangles, first);
  removed_[hole.vertex] = 1;
  live_triangles_ -= removal.star_count - count;
  return removal;
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
        opposite_[h] = opposite_[old];
        if (opposite_[h] != kNone32) opposite_[opposite_[h]] = h;
        border_[id] |= static_cast<uint8_t>(IsBorderEdge(old) << c);
      } else if (hole.IsNewBorder(a, b)) {
        border_[id] |= static_cast<uint8_t>(1 << c);
      } else {
        diagonal[a][b] = h;
      }
    }
  }
  for (uint32_t t = 1; t < count; ++t) {  // each hangs on the diagonal (i, j)
    const auto [i, m, j] = triangles[t];
    opposite_[diagonal[i][j]] = diagonal[j][i];
    opposite_[diagonal[j][i]] = diagonal[i][j];
  }
  // Outgoing half-edges of the ring; a border vertex keeps the one on the border.
  for (uint32_t h = 3 * first; h < 3 * (first + count); ++h) {
    const uint32_t a = Origin(h);
    if (!alive_[half_edge_[a] / 3]) half_edge_[a] = h;
  }
  for (uint32_t h = 3 * first; h < 3 * (first + count); ++h) {
    if (opposite_[h] == kNone32) half_edge_[Origin(h)] = h;
  }
}

void TileMesh::CopyTo(TileResult& result) const {
  result.vertices = vertices_;
  result.first_corner = first_corner_;
  result.positions = grid_positions_;
  result.triangles = corners_;
  result.border_edges = border_;
  result.alive = alive_;
  result.fixed = fixed_;
  result.holes = holes_;
  result.stars = stars_;
}

}  // namespace mtdb::internal
