// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/tile_measure.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "builder/measure/vertex_heights.h"
#include "store/base/float4.h"

namespace mtdb::internal {

namespace {
// The next larger float than that nearest to x, which is at least 0.
float RoundedUp(double x) {
  return std::bit_cast<float>(std::bit_cast<uint32_t>(static_cast<float>(x)) + 1);
}
}  // namespace

TileMeasure::Surface TileMeasure::LoadTile(const TileMesh& mesh, std::span<const TileTriangle> tile,
                                           const TileSurface* surface, const Grid& grid) {
  Surface all;
  mesh_ = &mesh;
  const size_t n = tile.size();
  triangles_.assign(n, Triangle{});
  for (size_t t = 0; t < n; ++t) {
    triangles_[t].error = tile[t].error;
    triangles_[t].edge_errors.fill(tile[t].error);
    triangles_[t].own = surface == nullptr || surface->own[t] != 0;
  }
  positions_.clear();
  for (uint32_t v = 0; v < mesh.vertices(); ++v) positions_.push_back(mesh.position(v));
  held_.clear();
  held_in_use_ = 0;
  if (surface != nullptr) {
    all.local = NumberVertices(*surface, mesh.vertex_numbers());
    for (size_t v = 0; v < all.local.size(); ++v) {
      if (all.local[v] < mesh.vertices()) continue;
      positions_.push_back(grid.is_linear() ? ToDouble(surface->positions[v])
                                            : grid.Position(surface->positions[v]));
    }
  }
  next_on_chain_.assign(positions_.size(), kNone32);
  for (uint32_t t = 0; t < n; ++t) {
    if (!triangles_[t].own) continue;
    all.triangles.push_back(mesh.corners(t));
    all.errors.push_back(tile[t].error);
  }
  if (surface != nullptr) {
    for (const auto& [a, b, c] : surface->triangles) {
      all.triangles.push_back({all.local[a], all.local[b], all.local[c]});
    }
    all.errors.insert(all.errors.end(), surface->errors.begin(), surface->errors.end());
    LoadHeld(*surface, all.local);
  }
  // An edge's error counts for both of its triangles.
  const std::span<const uint32_t> opposites = mesh.input_opposites();
  for (uint32_t h = 0; h < 3 * n; ++h) {
    const uint32_t o = opposites[h];
    if (o == kNone32 || o < h) continue;
    double& error = triangles_[h / 3].edge_errors[h % 3];
    double& twin_error = triangles_[o / 3].edge_errors[o % 3];
    error = twin_error = std::max(error, twin_error);
  }
  MeasureVertices(all);
  heights_ =
      VertexHeights(mesh.input_corners(), std::span(positions_).first(mesh.vertices()), vertical_);
  opened_in_.assign(positions_.size(), 0);
  opened_ = 0;
  Close();
  return all;
}

// `local`: of the surface's vertices.
void TileMeasure::LoadHeld(const TileSurface& surface, std::span<const uint32_t> local) {
  for (size_t t = 0; t < triangles_.size(); ++t) {
    for (size_t c = 0; c < 3; ++c) triangles_[t].edge_errors[c] = surface.edge_errors[t][c];
  }
  std::vector<std::pair<uint32_t, uint32_t>> inside;
  for (const HeldVertex& held : surface.held) {
    if (held.edge == 3) {
      inside.push_back({held.triangle, local[held.vertex]});
      continue;
    }
    uint32_t& head = triangles_[held.triangle].chain_heads[held.edge];
    next_on_chain_[local[held.vertex]] = head;
    head = local[held.vertex];
  }
  HoldIn(0, static_cast<uint32_t>(triangles_.size()), inside);
}

void TileMeasure::MeasureVertices(const Surface& surface) {
  vertex_errors_.assign(positions_.size(), 0);
  for (size_t t = 0; t < surface.triangles.size(); ++t) {
    for (const uint32_t v : surface.triangles[t]) {
      vertex_errors_[v] = std::max<double>(vertex_errors_[v], surface.errors[t]);
    }
  }
}

template <typename Items>
void TileMeasure::HoldIn(uint32_t first, uint32_t triangles, const Items& items) {
  const std::span<Triangle> parts = std::span(triangles_).subspan(first, triangles);
  for (const auto& [t, vertex] : items) ++parts[t].held_end;
  auto at = static_cast<uint32_t>(held_.size());
  for (Triangle& part : parts) {
    at += part.held_end;
    part.held_begin = part.held_end = at;
  }
  held_.resize(at);
  held_in_use_ += items.size();
  for (const auto& [t, vertex] : items) held_[--parts[t].held_begin] = vertex;
}

// Of triangles that are gone.
void TileMeasure::FreeHeld(std::span<const uint32_t> triangles) {
  constexpr size_t kSpare = 1 << 16;
  for (const uint32_t t : triangles) {
    held_in_use_ -= HeldBy(t).size();
    triangles_[t].held_begin = triangles_[t].held_end = 0;
  }
  if (held_.size() < 4 * held_in_use_ + kSpare) return;
  std::vector<uint32_t> kept;
  kept.reserve(held_.size() / 2);
  for (Triangle& t : triangles_) {
    const auto begin = static_cast<uint32_t>(kept.size());
    kept.insert(kept.end(), held_.begin() + t.held_begin, held_.begin() + t.held_end);
    t.held_begin = begin;
    t.held_end = static_cast<uint32_t>(kept.size());
  }
  held_ = std::move(kept);
}

void TileMeasure::End(TileResult& result) const {
  result.errors.reserve(triangles_.size());
  result.edge_errors.reserve(3 * triangles_.size());
  for (uint32_t t = 0; t < triangles_.size(); ++t) {
    result.errors.push_back(triangles_[t].error);
    for (const double error : triangles_[t].edge_errors) {
      result.edge_errors.push_back(RoundedUp(error));
    }
    if (!result.alive[t]) continue;
    for (const uint32_t w : HeldBy(t)) result.held.push_back({w, t, 3});
    for (uint32_t c = 0; c < 3; ++c) {
      ForEachOnChain(3 * t + c, [&](uint32_t w) { result.held.push_back({w, t, c}); });
    }
  }
}

void TileMeasure::GatherSamples(const Hole& hole) {
  if (std::exchange(gathered_, true)) return;
  samples_.clear();
  ++opened_;
  for (const uint32_t t : hole.star) {
    for (const uint32_t w : HeldBy(t)) {
      // Several triangles of a height field may stand for it.
      if (vertical_ && std::exchange(opened_in_[w], opened_) == opened_) continue;
      samples_.push_back(w);
      __builtin_prefetch(&positions_[w]);
    }
  }
  if (!hole.boundary) samples_.push_back(hole.vertex);
  points_.resize(samples_.size());
  for (size_t s = 0; s < samples_.size(); ++s) points_[s] = hole.InFrame(positions_[samples_[s]]);
}

bool TileMeasure::IsFresh(const Hole& hole) const {
  return !hole.boundary && samples_.size() == 1 &&
         std::all_of(hole.star.begin(), hole.star.end(),
                     [&](uint32_t t) { return triangles_[t].own; });
}

// From the samples that lie near an edge.
void TileMeasure::GuessEdges(Hole& hole) const {
  // More than these hardly change a guess.
  constexpr size_t kMost = 64;
  const size_t count = std::min(spread_.size(), kMost);
  hole.ForEachDiagonal([&](uint32_t i, uint32_t j) {
    // How far points near the edge's line stand off it; nearer ones count more.
    const Vec3d origin = hole.points[i] * spread_.scale;
    const Vec3d d = hole.points[j] * spread_.scale - origin;
    const double length2 = d.x * d.x + d.y * d.y;
    if (!(length2 > 0)) {
      hole.edge_error[i][j] = 0;
      return;
    }
    // Along the edge in units of its length; across it likewise.
    const auto ux = static_cast<float>(d.x / length2);
    const auto uy = static_cast<float>(d.y / length2);
    const auto dz = static_cast<float>(d.z);
    const auto ox = static_cast<float>(origin.x);
    const auto oy = static_cast<float>(origin.y);
    const auto oz = static_cast<float>(origin.z);
    Float4 most{};
    for (size_t p = 0; p < count; p += 4) {
      const Float4 px = Load4<Float4>(&spread_.x[p]) - ox;
      const Float4 py = Load4<Float4>(&spread_.y[p]) - oy;
      const Float4 pz = Load4<Float4>(&spread_.z[p]) - oz;
      const Float4 t = px * ux + py * uy;
      const Float4 side = px * uy - py * ux;
      const Float4 off = pz - t * dz;
      const Float4 value = (off < 0 ? -off : off) * (1 - 4 * side * side);
      most = Max4(most, ((t > 0) & (t < 1)) ? value : Float4{});
    }
    const float guess = std::max(std::max(most[0], most[1]), std::max(most[2], most[3]));
    hole.edge_error[i][j] = guess / spread_.scale;
  });
}

// A diagonal's curve runs over the star in the plane along z. Diagonals that leave the star get
// kUnknown.
template <bool kIsVertical>
void TileMeasure::MeasureOverSpokes(Hole& hole) const {
  const uint32_t k = hole.k;
  std::array<double, Hole::kMaxRing> spoke_error;  // what the surface around it has accumulated
  for (uint32_t m = 0; m < k; ++m) {
    spoke_error[m] = std::max(triangles_[hole.star[m]].error,
                              triangles_[hole.star[m == 0 ? k - 1 : m - 1]].error);
  }
  const Vec3d apex = points_[0];
  hole.ForEachDiagonal([&](uint32_t i, uint32_t j) {
    const Vec3d origin = hole.points[i];
    const Vec3d d = hole.points[j] - origin;
    const Vec3d to_apex = apex - origin;
    const double apex_side = d.x * to_apex.y - d.y * to_apex.x;
    const double length2 = SquaredLength(d);
    double& error = hole.edge_error[i][j];
    error = 0;
    // The ring beyond the edge, seen from the apex.
    const bool left = apex_side >= 0;
    const uint32_t begin = left ? i + 1 : j + 1;
    const uint32_t end = left ? j : i + k;
    for (uint32_t r = begin; r < end; ++r) {
      const uint32_t m = r < k ? r : r - k;
      const Vec3d to_ring = hole.points[m] - origin;
      const double ring_side = d.x * to_ring.y - d.y * to_ring.x;
      if (left ? ring_side >= 0 : ring_side <= 0) {
        error = kUnknown;
        return;
      }
      // The crossing c; w * (c - origin) needs no division.
      const double w = std::abs(apex_side - ring_side);
      const Vec3d wc = to_apex * w + (to_ring - to_apex) * std::abs(apex_side);
      if (kIsVertical) {
        const double at_edge = d.z * ((wc.x * d.x + wc.y * d.y) / (d.x * d.x + d.y * d.y));
        error = std::max(error, std::abs(wc.z - at_edge) / w + spoke_error[m]);
        continue;
      }
      const double t = Dot(wc, d);
      const Vec3d offset = t <= 0 ? wc : t >= length2 * w ? wc - d * w : wc - d * (t / length2);
      error = std::max(error, Length(offset) / w + spoke_error[m]);
    }
  });
}

template void TileMeasure::MeasureOverSpokes<true>(Hole&) const;
template void TileMeasure::MeasureOverSpokes<false>(Hole&) const;

double TileMeasure::EdgeError(const Hole& hole, uint32_t a, uint32_t b) const {
  if (b == a + 1) return edge_error(hole.ring_edges[a]);
  if (hole.OnRing(b, a)) return edge_error(hole.ring_edges[b]);
  return hole.edge_error[a][b];
}

void TileMeasure::TakeEdgeErrors(const Hole& hole, Filling& filling) const {
  for (uint32_t t = 0; t + 2 < hole.k; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    filling.errors[t] =
        std::max({EdgeError(hole, i, m), EdgeError(hole, m, j), EdgeError(hole, i, j)});
  }
}

double TileMeasure::RimError(const Hole& hole) const {
  double error = hole.boundary ? hole.edge_error[0][hole.k - 1] : 0;
  for (const uint32_t h : hole.ring_edges) error = std::max(error, edge_error(h));
  return error;
}

double TileMeasure::LowerBound(const Hole& hole, const Filling& filling) const {
  double bound = RimError(hole);
  for (uint32_t t = 1; t < hole.k - 2; ++t) {
    bound = std::max(bound, hole.edge_error[filling.triangles[t][0]][filling.triangles[t][2]]);
  }
  return bound;
}

void TileMeasure::Add(const Hole& hole, const Filling& filling, uint32_t first, uint32_t new_chain,
                      std::span<const std::pair<uint8_t, uint32_t>> charges) {
  const uint32_t count = hole.k - 2;
  FreeHeld(hole.star);
  for (uint32_t t = 0; t < count; ++t) {
    Triangle made;
    made.error = RoundedUp(filling.errors[t]);
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [a, b] = Hole::Edge(filling.triangles[t], c);
      if (hole.OnRing(a, b)) {  // takes over what the star's half-edge had
        const uint32_t h = hole.ring_edges[a];
        made.edge_errors[c] = edge_error(h);
        made.chain_heads[c] = chain_head(h);
      } else if (hole.IsNewBorder(a, b)) {
        made.edge_errors[c] = hole.edge_error[b][a];
        made.chain_heads[c] = new_chain;
      } else {
        const auto [i, j] = std::minmax(a, b);
        made.edge_errors[c] = hole.edge_error[i][j];
      }
    }
    triangles_.push_back(made);
  }
  std::vector<std::pair<uint32_t, uint32_t>> held;
  for (const auto& [triangle, s] : charges) held.push_back({triangle, samples_[s]});
  HoldIn(first, count, held);
}

// The new border edge's chain: both old ones and the vertex that goes, which is its head.
uint32_t TileMeasure::JoinBorderChains(const Hole& hole) {
  next_on_chain_[hole.vertex] = chain_head(hole.border_out);
  uint32_t tail = hole.vertex;
  while (next_on_chain_[tail] != kNone32) tail = next_on_chain_[tail];
  next_on_chain_[tail] = chain_head(hole.border_in);
  return hole.vertex;
}

}  // namespace mtdb::internal
