// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/surface_distance.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace mtdb::internal {

namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double SquaredDistance(const Hole& hole, const Hole::Triangle& triangle, Vec3d p) {
  const auto [i, m, j] = triangle;
  return SquaredDistancePointTriangle(p, hole.positions[i], hole.positions[m], hole.positions[j]);
}
}  // namespace

void SurfaceDistance::Begin(const TileMesh& mesh, std::span<const TileTriangle> tile,
                            const Grid& grid, const MeasureOptions& options) {
  const TileSurface* const surface = options.surface;
  const auto [triangles, errors, local] = LoadTile(mesh, tile, surface, grid);
  std::vector<uint32_t> numbers(mesh.vertex_numbers().begin(), mesh.vertex_numbers().end());
  std::vector<Chord> chords;
  std::span<const uint32_t> opposites = mesh.input_opposites();
  std::vector<uint32_t> paired;
  if (surface != nullptr) {
    PairHalfEdges(triangles, static_cast<uint32_t>(positions_.size()), paired);
    opposites = paired;
    numbers.resize(positions_.size());
    for (size_t v = 0; v < local.size(); ++v) numbers[local[v]] = surface->vertices[v];
    chords = surface->chords;
    for (Chord& chord : chords) {
      chord.from = local[chord.from];
      chord.to = local[chord.to];
    }
  }
  LoadTexture(options, local);
  map_.Build(mesh, triangles, opposites, errors, numbers);
  map_.AddChords(std::move(chords), mesh, numbers);
}

// `local`: of the surface's vertices.
void SurfaceDistance::LoadTexture(const MeasureOptions& options, std::span<const uint32_t> local) {
  texture_.clear();
  if (options.textured == nullptr) return;
  const auto add = [&](const TextureCorner& corner) {
    texture_.push_back(Vec3d{corner.u, corner.v, 0} * options.texture_scale);
  };
  for (uint32_t v = 0; v < mesh_->vertices(); ++v) {
    add(options.textured->texture(mesh_->first_corner(v), options.row_bytes));
  }
  for (size_t v = 0; v < local.size(); ++v) {
    if (local[v] >= mesh_->vertices()) add(options.surface->corners[v]);
  }
}

double SurfaceDistance::FromTriangle(const Hole& hole, uint32_t v,
                                     const Hole::Triangle& triangle) const {
  if (!textured()) return std::sqrt(SquaredDistance(hole, triangle, positions_[v]));
  const auto [i, m, j] = triangle;
  return PointTriangleSlip(At(v), {At(hole.ring[i]), At(hole.ring[m]), At(hole.ring[j])});
}

double SurfaceDistance::FromDiagonal(const Hole& hole, uint32_t a, uint32_t b, uint32_t i,
                                     uint32_t j) const {
  if (textured()) return SegmentSegmentSlip(At(a), At(b), At(hole.ring[i]), At(hole.ring[j]));
  return std::sqrt(SquaredDistanceSegmentSegment(positions_[a], positions_[b], hole.positions[i],
                                                 hole.positions[j]));
}

void SurfaceDistance::End(TileResult& result) const {
  TileMeasure::End(result);
  map_.Hold(result.alive, result.chords);
}

void SurfaceDistance::Open(Hole& hole) {
  Close();
  for (const uint32_t t : hole.star) __builtin_prefetch(&triangles_[t]);
  looked_ = looked_at_ = false;
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
  star_.fresh = IsFresh(hole);
  if (star_.fresh) return;
  double squared = 0;
  for (uint32_t i = 0; i < hole.k; ++i) squared = std::max(squared, SquaredLength(hole.points[i]));
  for (const Vec3d& p : points_) squared = std::max(squared, SquaredLength(p));
  star_.size = squared > 0 ? std::sqrt(squared) : 1;
  spread_.Set(points_, 1 / star_.size);
}

// The border vertices that were removed between the ends of the new border edge lie on it.
void SurfaceDistance::MeasureBorder(Hole& hole) const {
  double error = 0;
  ForEachOnNewBorder(hole, [&](uint32_t w) {
    const double distance =
        textured() ? PointSegmentSlip(At(w), At(hole.ring[hole.k - 1]), At(hole.ring[0]))
                   : std::sqrt(SquaredDistancePointSegment(
                         positions_[w], hole.positions[hole.k - 1], hole.positions[0]));
    error = std::max(error, distance + vertex_error(w));
  });
  hole.edge_error[0][hole.k - 1] = error;
}

// Of a star of the surface itself they are not too low, but for those that leave it, which are not
// used then.
bool SurfaceDistance::PriceEdges(Hole& hole) {
  if (star_.fresh) {
    MeasureOverSpokes<false>(hole);
  } else {
    GuessEdges(hole);
  }
  return false;
}

bool SurfaceDistance::FindParts(const Hole& hole) {
  if (std::exchange(looked_, true)) return known_;
  map_.Open(hole);
  if (hole.boundary) ForEachOnNewBorder(hole, [&](uint32_t w) { samples_.push_back(w); });
  for (uint32_t s = 0; s < samples_.size(); ++s) map_.MarkSample(samples_[s], s);
  for (uint32_t r = 0; r < hole.ring_edges.size(); ++r) {
    ForEachOnChain(hole.ring_edges[r], [&](uint32_t w) { map_.MarkChain(w, r); });
  }
  known_ = map_.FindParts();
  return known_;
}

// Makes the filling the one that homes are of.
void SurfaceDistance::LookAt(const Hole& hole, const Filling& filling) {
  if (looked_at_ && filling.IsOf(seen_, hole.k)) return;
  looked_at_ = true;
  at_home_ = placed_ = false;
  seen_ = filling.triangles;
  if (!star_.fresh) lanes_.Set(hole, seen_, spread_.scale);
}

// Where the removed vertices that are points go. Homes are chosen by distances in binary32; of a
// star of the surface itself, where the vertex goes, in binary64.
void SurfaceDistance::FindHomes(const Hole& hole) {
  if (std::exchange(at_home_, true)) return;
  if (!star_.fresh) {
    lanes_.FindNearest(spread_, squared_, homes_);
    return;
  }
  homes_.assign(1, 0);
  double least = kInfinity;
  for (uint32_t t = 0; t + 2 < hole.k; ++t) {
    const double squared = SquaredDistance(hole, seen_[t], hole.apex);
    if (squared >= least) continue;
    least = squared;
    homes_[0] = t;
  }
  distance_ = std::sqrt(least);
}

// And where ends of paths lie. The new border edge is one of triangle 0.
void SurfaceDistance::PlaceEnds(const Hole& hole) {
  FindHomes(hole);
  if (std::exchange(placed_, true)) return;
  homes_.resize(points_.size());
  homes_.resize(samples_.size(), 0);
  masks_.Set(hole, seen_, homes_);
}

double SurfaceDistance::FirstBound(const Hole& hole, const Filling& filling, double enough) {
  double bound = RimError(hole);
  if (bound > enough || points_.empty()) return bound;
  LookAt(hole, filling);
  if (star_.fresh) {
    FindHomes(hole);
    return std::max(bound, distance_ + vertex_error(hole.vertex));
  }
  if (!hole.boundary) {
    const double about = std::sqrt(double{lanes_.SquaredDistance(points_.back())}) * star_.size;
    bound = std::max(bound, about + vertex_error(hole.vertex));
    if (bound > enough) return bound;
  }
  FindHomes(hole);
  for (size_t s = 0; s < points_.size(); ++s) {
    bound = std::max(bound, AboutDistance(s) + vertex_error(samples_[s]));
  }
  return bound;
}

// Over a star of the surface itself: diagonals cross its spokes.
void SurfaceDistance::MeasureFreshEdges(Hole& hole, const Filling& filling) {
  FindHomes(hole);
  const auto [hi, hm, hj] = filling.triangles[homes_[0]];
  const uint32_t k = hole.k;
  for (uint32_t t = 1; t + 2 < k; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    const bool home_behind = hi >= i && hj <= j;
    double error = 0;
    const uint32_t begin = home_behind ? j + 1u : i + 1u;
    const uint32_t end = home_behind ? i + k : j;
    for (uint32_t n = begin; n < end; ++n) {
      const uint32_t r = n < k ? n : n - k;
      const double distance = FromDiagonal(hole, hole.vertex, hole.ring[r], i, j);
      const double own = std::max(triangles_[hole.star[r]].error,
                                  triangles_[hole.star[r == 0 ? k - 1 : r - 1]].error);
      error = std::max(error, distance + own);
    }
    hole.edge_error[i][j] = error;
  }
}

void SurfaceDistance::MeasureEdges(Hole& hole, const Filling& filling, const Hole::PerEdge<bool>&) {
  LookAt(hole, filling);
  if (star_.fresh) {
    MeasureFreshEdges(hole, filling);
    return;
  }
  const bool known = FindParts(hole);
  std::array<double, Hole::kMaxRing> errors{};
  if (known) {
    PlaceEnds(hole);
    MeasureCrossings(hole, filling, errors);
  }
  for (uint32_t t = 1; t + 2 < hole.k; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    hole.edge_error[i][j] = known ? errors[t] : -1;
  }
}

// `errors`: of the diagonals, by the triangle that hangs on each.
void SurfaceDistance::MeasureCrossings(const Hole& hole, const Filling& filling,
                                       std::array<double, Hole::kMaxRing>& errors) const {
  const auto cross = [&](uint32_t e, uint32_t crossed) {
    const SurfaceEdges::Edge& edge = map_.edge(e);
    for (; crossed != 0; crossed &= crossed - 1) {
      const auto t = static_cast<uint32_t>(std::countr_zero(crossed));
      const auto [i, m, j] = filling.triangles[t];
      errors[t] = std::max(errors[t], FromDiagonal(hole, edge.from, edge.to, i, j) + edge.error);
    }
  };
  for (const SurfaceMap::InnerEdge& inner : map_.inner_edges()) {
    const uint32_t crossed = masks_.Between(inner.from, inner.to);
    if (crossed != 0 && !map_.HasPath(inner.edge)) cross(inner.edge, crossed);
  }
  for (const SurfaceMap::Part& part : map_.parts()) {
    cross(part.edge, masks_.Between(part.from, part.to));
  }
}

void SurfaceDistance::Measure(const Hole& hole, Filling& filling) {
  charges_.clear();
  if (!FindParts(hole)) {
    filling.errors.fill(kInfinity);
    filling.error = kInfinity;
    return;
  }
  LookAt(hole, filling);
  PlaceEnds(hole);
  TakeEdgeErrors(hole, filling);
  for (uint32_t s = 0; s < points_.size(); ++s) {
    charges_.push_back({static_cast<uint8_t>(homes_[s]), s});
    double& error = filling.errors[homes_[s]];
    const double own = vertex_error(samples_[s]);
    // What rounding may hide is far less than this.
    if (!star_.fresh && !textured() && AboutDistance(s) * 1.001 + 1e-4 * star_.size + own <= error)
      continue;
    error = std::max(error, FromTriangle(hole, samples_[s], filling.triangles[homes_[s]]) + own);
  }
  filling.error = *std::max_element(filling.errors.begin(), filling.errors.begin() + (hole.k - 2));
}

void SurfaceDistance::HandOn(const Hole& hole, const Filling& filling, uint32_t first) {
  map_.HandOn(hole, filling.triangles, masks_, first);
  Add(hole, filling, first, hole.boundary ? JoinBorderChains(hole) : kNone32, charges_);
}

}  // namespace mtdb::internal
