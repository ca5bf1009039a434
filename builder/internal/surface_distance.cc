// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/surface_distance.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "store/base/float4.h"

namespace mtdb::internal {

namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();

double SquaredDistance(const Hole& hole, const Hole::Triangle& triangle, Vec3d p) {
  const auto [i, m, j] = triangle;
  return SquaredDistancePointTriangle(p, hole.positions[i], hole.positions[m], hole.positions[j]);
}

// Height over length: rounding decides what lies over thinner triangles.
constexpr double kNeedle = 1.0 / 128;

// A triangle of a filling for four points at once, in binary32 and the hole's frame. Of a needle
// only the edges count, which are nowhere nearer than the triangle.
class TriangleLanes {
 public:
  TriangleLanes(const Hole& hole, const Hole::Triangle& triangle) {
    const Vec3d first = hole.points[triangle[0]];
    const Vec3d up = Cross(hole.points[triangle[1]] - first, hole.points[triangle[2]] - first);
    const double length = Length(up);
    const Vec3d normal = up * (length > 0 ? 1 / length : 0);
    normal_ = Splat(normal);
    double longest2 = 0;
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [a, b] = Hole::Edge(triangle, c);
      const Vec3d along = hole.points[b] - hole.points[a];
      const double squared = SquaredLength(along);
      longest2 = std::max(longest2, squared);
      corner_[c] = Splat(hole.points[a]);
      along_[c] = Splat(along);
      per_length2_[c] = Splat4(squared > 0 ? static_cast<float>(1 / squared) : 0);
      inwards_[c] = Splat(Cross(normal, along));
    }
    constexpr float kNowhere = std::numeric_limits<float>::infinity();
    least_ = Splat4(length > kNeedle * longest2 ? 0 : kNowhere);
  }
  Float4 SquaredDistance(Float4 x, Float4 y, Float4 z) const {
    Float4 least{};
    Int4 over{};
    for (uint32_t c = 0; c < 3; ++c) {
      const Lanes p{x - corner_[c].x, y - corner_[c].y, z - corner_[c].z};
      const Float4 t = Min4(Max4(Dot(p, along_[c]) * per_length2_[c], Float4{}), Splat4(1));
      const Lanes off{p.x - t * along_[c].x, p.y - t * along_[c].y, p.z - t * along_[c].z};
      const Float4 squared = Dot(off, off);
      const Int4 inside = Dot(p, inwards_[c]) >= least_;
      least = c == 0 ? squared : Min4(least, squared);
      over = c == 0 ? inside : over & inside;
    }
    const Float4 height = Dot({x - corner_[0].x, y - corner_[0].y, z - corner_[0].z}, normal_);
    return over ? height * height : least;
  }

 private:
  struct Lanes {
    Float4 x, y, z;
  };
  static Lanes Splat(Vec3d v) {
    return {Splat4(static_cast<float>(v.x)), Splat4(static_cast<float>(v.y)),
            Splat4(static_cast<float>(v.z))};
  }
  static Float4 Dot(const Lanes& a, const Lanes& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

  Lanes normal_;
  std::array<Lanes, 3> corner_, along_, inwards_;  // of the edges
  std::array<Float4, 3> per_length2_;
  Float4 least_;  // inwards of the edges: what lies over it
};
}  // namespace

void SurfaceDistance::Load(const TileMesh& mesh, std::span<const TileTriangle> tile,
                           const TileSurface* surface, const Grid& grid) {
  const auto [triangles, errors, local] = LoadTile(mesh, tile, surface, grid);
  std::vector<uint32_t> numbers(mesh.vertex_numbers().begin(), mesh.vertex_numbers().end());
  std::vector<Chord> chords;
  if (surface != nullptr) {
    numbers.resize(positions_.size());
    for (size_t v = 0; v < local.size(); ++v) numbers[local[v]] = surface->vertices[v];
    chords = surface->chords;
    for (Chord& chord : chords) {
      chord.from = local[chord.from];
      chord.to = local[chord.to];
    }
  }
  map_.Build(mesh, triangles, errors, numbers);
  map_.AddChords(std::move(chords), mesh, numbers);
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
  fresh_ = IsFresh(hole);
  if (fresh_) return;
  SpreadPoints();
  size_ = 0;
  for (uint32_t i = 0; i < hole.k; ++i) size_ = std::max(size_, Length(hole.points[i]));
  for (const Vec3d& p : points_) size_ = std::max(size_, Length(p));
}

// The border vertices that were removed between the ends of the new border edge lie on it.
void SurfaceDistance::MeasureBorder(Hole& hole) const {
  double error = 0;
  ForEachOnNewBorder(hole, [&](uint32_t w) {
    const double squared =
        SquaredDistancePointSegment(positions_[w], hole.positions[hole.k - 1], hole.positions[0]);
    error = std::max(error, std::sqrt(squared) + vertex_error(w));
  });
  hole.edge_error[0][hole.k - 1] = error;
}

// Of a star of the surface itself they are not too low, but for those that leave it, which are not
// used then.
bool SurfaceDistance::PriceEdges(Hole& hole) {
  if (fresh_) {
    MeasureOverSpokes(hole);
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

// Homes are chosen by distances in binary32.
void SurfaceDistance::FindHomes(const Hole& hole, const Filling& filling) {
  at_home_ = true;
  homes_.assign(samples_.size(), 0);  // the new border edge is one of triangle 0
  squared_.assign(points_.size() + 3, std::numeric_limits<float>::infinity());
  masks_.Set(hole, filling.triangles);
  if (points_.empty()) return;
  for (uint8_t t = 0; t + 2u < hole.k; ++t) {
    const TriangleLanes triangle(hole, filling.triangles[t]);
    for (size_t s = 0; s < points_.size(); s += 4) {
      const Float4 squared = triangle.SquaredDistance(Load4<Float4>(&x_[s]), Load4<Float4>(&y_[s]),
                                                      Load4<Float4>(&z_[s]));
      const Float4 before = Load4<Float4>(&squared_[s]);
      uint32_t nearer = MaskBits(squared < before);
      if (nearer == 0) continue;
      Store4(&squared_[s], Min4(squared, before));
      for (; nearer != 0; nearer &= nearer - 1) {
        const size_t at = s + static_cast<size_t>(std::countr_zero(nearer));
        if (at < points_.size()) homes_[at] = t;
      }
    }
  }
}

// Of a star of the surface itself: where the vertex goes.
void SurfaceDistance::FindHome(const Hole& hole, const Filling& filling) {
  at_home_ = true;
  homes_.assign(1, 0);
  double least = kInfinity;
  for (uint8_t t = 0; t + 2u < hole.k; ++t) {
    const double squared = SquaredDistance(hole, filling.triangles[t], hole.apex);
    if (squared >= least) continue;
    least = squared;
    homes_[0] = t;
  }
  squared_.assign(1, static_cast<float>(least));
}

double SurfaceDistance::FirstBound(const Hole& hole, const Filling& filling, double enough) {
  double bound = RimError(hole);
  if (bound > enough || points_.empty()) return bound;
  if (fresh_) {
    FindHome(hole, filling);
    return std::max(bound, std::sqrt(double{squared_[0]}) + vertex_error(hole.vertex));
  }
  if (!hole.boundary) {
    double least = kInfinity;
    for (uint32_t t = 0; t + 2 < hole.k; ++t) {
      least = std::min(least, SquaredDistance(hole, filling.triangles[t], hole.apex));
    }
    bound = std::max(bound, std::sqrt(least) + vertex_error(hole.vertex));
    if (bound > enough) return bound;
  }
  FindHomes(hole, filling);
  for (size_t s = 0; s < points_.size(); ++s) {
    bound = std::max(bound, std::sqrt(double{squared_[s]}) + vertex_error(samples_[s]));
  }
  return bound;
}

// Over a star of the surface itself: diagonals cross its spokes.
void SurfaceDistance::MeasureFreshEdges(Hole& hole, const Filling& filling) {
  FindHome(hole, filling);
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
      const double squared = SquaredDistanceSegmentSegment(hole.apex, hole.positions[r],
                                                           hole.positions[i], hole.positions[j]);
      const double own = std::max(triangles_[hole.star[r]].error,
                                  triangles_[hole.star[r == 0 ? k - 1 : r - 1]].error);
      error = std::max(error, std::sqrt(squared) + own);
    }
    hole.edge_error[i][j] = error;
  }
}

void SurfaceDistance::MeasureEdges(Hole& hole, const Filling& filling, const Hole::PerEdge<bool>&) {
  if (fresh_) {
    MeasureFreshEdges(hole, filling);
    return;
  }
  at_home_ &= !looked_;
  const bool known = FindParts(hole);
  if (known && (!at_home_ || homes_.size() != samples_.size())) FindHomes(hole, filling);
  std::array<double, Hole::kMaxRing> errors{};
  if (known) MeasureCrossings(hole, filling, errors);
  for (uint32_t t = 1; t + 2 < hole.k; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    hole.edge_error[i][j] = known ? errors[t] : -1;
  }
}

// `errors`: of the diagonals, by the triangle that hangs on each.
void SurfaceDistance::MeasureCrossings(const Hole& hole, const Filling& filling,
                                       std::array<double, Hole::kMaxRing>& errors) const {
  const auto cross = [&](uint32_t e, uint32_t crossed) {
    const SurfaceMap::Edge& edge = map_.edge(e);
    for (; crossed != 0; crossed &= crossed - 1) {
      const auto t = static_cast<uint32_t>(std::countr_zero(crossed));
      const auto [i, m, j] = filling.triangles[t];
      const double squared = SquaredDistanceSegmentSegment(
          positions_[edge.from], positions_[edge.to], hole.positions[i], hole.positions[j]);
      errors[t] = std::max(errors[t], std::sqrt(squared) + edge.error);
    }
  };
  for (const SurfaceMap::InnerEdge& inner : map_.inner_edges()) {
    const uint32_t crossed = masks_.Between(inner.from, inner.to, homes_);
    if (crossed != 0 && !map_.HasPath(inner.edge)) cross(inner.edge, crossed);
  }
  for (const SurfaceMap::Part& part : map_.parts()) {
    cross(part.edge, masks_.Between(part.from, part.to, homes_));
  }
}

void SurfaceDistance::Measure(const Hole& hole, Filling& filling) {
  charges_.clear();
  if (!FindParts(hole)) {
    filling.errors.fill(kInfinity);
    filling.error = kInfinity;
    return;
  }
  if (fresh_) {
    if (!at_home_) FindHome(hole, filling);
    masks_.Set(hole, filling.triangles);
  } else if (!at_home_ || homes_.size() != samples_.size()) {
    FindHomes(hole, filling);
  }
  TakeEdgeErrors(hole, filling);
  // In smaller holes squares of distances are too small for binary32.
  constexpr double kLeastSize = 1e-15;
  const bool about_is_known = !fresh_ && size_ > kLeastSize;
  for (uint32_t s = 0; s < points_.size(); ++s) {
    charges_.push_back({homes_[s], s});
    double& error = filling.errors[homes_[s]];
    // What rounding may hide is far less than this.
    const double about = std::sqrt(double{squared_[s]});
    const double own = vertex_error(samples_[s]);
    if (about_is_known && about * 1.001 + 1e-4 * size_ + own <= error) continue;
    const double squared =
        SquaredDistance(hole, filling.triangles[homes_[s]], positions_[samples_[s]]);
    error = std::max(error, std::sqrt(squared) + own);
  }
  filling.error = *std::max_element(filling.errors.begin(), filling.errors.begin() + (hole.k - 2));
}

void SurfaceDistance::HandOn(const Hole& hole, const Filling& filling, uint32_t first) {
  map_.HandOn(hole, filling.triangles, masks_, homes_, first);
  Add(hole, filling, first, hole.boundary ? JoinBorderChains(hole) : kNone32, charges_);
}

}  // namespace mtdb::internal
