// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/surface_distance.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace mtdb::internal {

namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The nearest triangle of a filling, and the square of its distance.
std::pair<uint8_t, double> Nearest(const Hole& hole, const Hole::Triangles& triangles, Vec3d p) {
  uint8_t nearest = 0;
  double least = kInfinity;
  for (uint8_t t = 0; t + 2u < hole.k; ++t) {
    const auto [i, m, j] = triangles[t];
    const double d =
        SquaredDistancePointTriangle(p, hole.positions[i], hole.positions[m], hole.positions[j]);
    if (d < least) {
      least = d;
      nearest = t;
    }
  }
  return {nearest, least};
}
}  // namespace

void SurfaceDistance::Load(const TileMesh& mesh, std::span<const TileTriangle> tile,
                           const TileSurface* surface, const Grid& grid) {
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<float> errors;
  LoadTile(mesh, tile, surface, grid, triangles, errors);
  std::vector<uint32_t> numbers(mesh.vertex_numbers().begin(), mesh.vertex_numbers().end());
  std::vector<Chord> chords;
  if (surface != nullptr) {
    const std::vector<uint32_t> local = NumberVertices(*surface, mesh.vertex_numbers());
    numbers.resize(positions_.size());
    for (size_t v = 0; v < local.size(); ++v) numbers[local[v]] = surface->vertices[v];
    chords = surface->chords;
    for (Chord& chord : chords) {
      chord.from = local[chord.from];
      chord.to = local[chord.to];
    }
  }
  map_.Build(mesh, triangles, errors, numbers);
  map_.AddChords(chords, mesh, numbers);
}

void SurfaceDistance::Hold(TileResult& result) const {
  TileMeasure::Hold(result);
  map_.Hold(result.alive, result.chords);
}

void SurfaceDistance::Open(Hole& hole) {
  Close();
  looked_ = at_home_ = false;
  if (hole.boundary) MeasureBorder(hole);
  Vec3d normal{};
  for (const uint32_t t : hole.star) {
    const auto& c = mesh_->corners(t);
    const Vec3d first = mesh_->position(c[0]);
    normal += Cross(mesh_->position(c[1]) - first, mesh_->position(c[2]) - first);
  }
  const double length = Length(normal);
  hole.LookAlong(length > 0 ? normal * (1 / length) : Vec3d{0, 0, 1}, length);
  GatherSamples(hole);
}

// The border vertices that were removed between the ends of the new border edge lie on it.
void SurfaceDistance::MeasureBorder(Hole& hole) const {
  double error = 0;
  ForEachOnNewBorder(hole, [&](uint32_t w) {
    const double squared = SquaredDistancePointSegment(positions_[w], hole.positions[hole.k - 1],
                                                       hole.positions[0]);
    error = std::max(error, std::sqrt(squared) + vertex_error(w));
  });
  hole.edge_error[0][hole.k - 1] = error;
}

// All but those over a star of the surface itself are guesses, and these are high at most.
bool SurfaceDistance::PriceEdges(Hole& hole) {
  GuessEdges(hole);
  if (!IsFresh(hole)) return false;
  const Hole::PerEdge<double> guesses = hole.edge_error;
  MeasureOverSpokes(hole);
  hole.ForEachDiagonal([&](uint32_t i, uint32_t j) {
    if (hole.edge_error[i][j] == kUnknown) hole.edge_error[i][j] = guesses[i][j];
  });
  return false;
}

bool SurfaceDistance::FindParts(const Hole& hole) {
  if (std::exchange(looked_, true)) return known_;
  map_.Open(hole);
  inner_samples_ = static_cast<uint32_t>(samples_.size());
  if (hole.boundary) ForEachOnNewBorder(hole, [&](uint32_t w) { samples_.push_back(w); });
  for (uint32_t s = 0; s < samples_.size(); ++s) map_.MarkSample(samples_[s], s);
  for (uint32_t r = 0; r < hole.ring_edges.size(); ++r) {
    ForEachOnChain(hole.ring_edges[r], [&](uint32_t w) { map_.MarkChain(w, r); });
  }
  known_ = map_.FindParts();
  return known_;
}

void SurfaceDistance::FindHomes(const Hole& hole, const Filling& filling) {
  homes_.assign(samples_.size(), 0);  // the new border edge is one of triangle 0
  squared_.resize(inner_samples_);
  for (uint32_t s = 0; s < inner_samples_; ++s) {
    std::tie(homes_[s], squared_[s]) = Nearest(hole, filling.triangles, positions_[samples_[s]]);
  }
  masks_.Set(hole, filling.triangles);
  at_home_ = true;
}

void SurfaceDistance::MeasureEdges(Hole& hole, const Filling& filling,
                                   const Hole::PerEdge<bool>&) {
  const bool known = FindParts(hole);
  if (known) FindHomes(hole, filling);
  std::array<double, Hole::kMaxRing> errors{};
  for (const SurfaceMap::Part& part : map_.parts()) {
    if (!known) break;
    const auto [behind_from, on_from] = masks_.Of(part.from, homes_);
    const auto [behind_to, on_to] = masks_.Of(part.to, homes_);
    uint32_t crossed = (behind_from ^ behind_to) & ~(on_from | on_to);
    const auto& [a, b] = map_.ends(part.edge);
    for (; crossed != 0; crossed &= crossed - 1) {
      const auto t = static_cast<uint32_t>(std::countr_zero(crossed));
      const auto [i, m, j] = filling.triangles[t];
      const double squared = SquaredDistanceSegmentSegment(
          positions_[a], positions_[b], hole.positions[i], hole.positions[j]);
      errors[t] = std::max(errors[t], std::sqrt(squared) + map_.error(part.edge));
    }
  }
  for (uint32_t t = 1; t + 2 < hole.k; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    hole.edge_error[i][j] = known ? errors[t] : -1;
  }
}

void SurfaceDistance::Measure(const Hole& hole, Filling& filling) {
  charges_.clear();
  if (!FindParts(hole)) {
    filling.errors.fill(kInfinity);
    filling.error = kInfinity;
    return;
  }
  if (!at_home_) FindHomes(hole, filling);
  TakeEdgeErrors(hole, filling);
  for (uint32_t s = 0; s < inner_samples_; ++s) {
    double& error = filling.errors[homes_[s]];
    error = std::max(error, std::sqrt(squared_[s]) + vertex_error(samples_[s]));
    charges_.push_back({homes_[s], s});
  }
  filling.error = *std::max_element(filling.errors.begin(), filling.errors.begin() + (hole.k - 2));
}

void SurfaceDistance::HandOn(const Hole& hole, const Filling& filling, uint32_t first) {
  map_.HandOn(hole, filling.triangles, masks_, homes_, first);
  Add(hole, filling, first, hole.boundary ? JoinBorderChains(hole) : kNone32, charges_);
}

}  // namespace mtdb::internal
