// SPDX-License-Identifier: Apache-2.0
#include "builder/measure/height_difference.h"

#include <algorithm>
#include <cmath>

#include "store/base/float4.h"

namespace mtdb::internal {

namespace {

// |Height| of p over the triangle's plane.
double HeightOver(Vec3d p, Vec3d a, Vec3d b, Vec3d c) {
  const double wa = Hole::Side(b, c, p);
  const double wb = Hole::Side(c, a, p);
  const double wc = Hole::Side(a, b, p);
  return std::abs((wa * (p.z - a.z) + wb * (p.z - b.z) + wc * (p.z - c.z)) / (wa + wb + wc));
}

// Likewise over the line ab, above which p lies.
double HeightOverEdge(Vec3d p, Vec3d a, Vec3d b) {
  const Vec3d ab = b - a;
  const Vec3d ap = p - a;
  return std::abs(ap.z - ab.z * (ap.x * ab.x + ap.y * ab.y) / (ab.x * ab.x + ab.y * ab.y));
}

// A triangle of a filling for four samples at once, in binary32.
class TriangleLanes {
 public:
  TriangleLanes(const Hole& hole, const Hole::Triangle& triangle) {
    const Vec3d corner = hole.points[triangle[0]];
    const Vec3d up = Cross(hole.points[triangle[1]] - corner, hole.points[triangle[2]] - corner);
    const double slope_x = up.x / up.z;
    const double slope_y = up.y / up.z;
    steepness_ = std::abs(slope_x) + std::abs(slope_y);
    slope_x_ = Splat4(static_cast<float>(slope_x));
    slope_y_ = Splat4(static_cast<float>(slope_y));
    height_ = Splat4(static_cast<float>(corner.z + slope_x * corner.x + slope_y * corner.y));
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [a, b] = Hole::Edge(triangle, c);
      const Vec3d from = hole.points[a];
      const Vec3d d = hole.points[b] - from;
      const double length = std::sqrt(d.x * d.x + d.y * d.y);
      x_[c] = Splat4(static_cast<float>(-d.y / length));
      y_[c] = Splat4(static_cast<float>(d.x / length));
      offset_[c] = Splat4(static_cast<float>((d.y * from.x - d.x * from.y) / length));
    }
  }
  // How far inside they are, seen along z; below 0: outside, by so much at least.
  Float4 Inwards(Float4 x, Float4 y) const {
    return Min4(Min4(x_[0] * x + y_[0] * y + offset_[0], x_[1] * x + y_[1] * y + offset_[1]),
                x_[2] * x + y_[2] * y + offset_[2]);
  }
  // How far off the triangle's plane they are, along z.
  Float4 HeightAbove(Float4 x, Float4 y, Float4 z) const {
    return Abs4(z + slope_x_ * x + slope_y_ * y - height_);
  }
  // How much the plane rises over a step along x and one along y.
  double steepness() const { return steepness_; }

 private:
  std::array<Float4, 3> x_, y_, offset_;  // of the edges
  Float4 slope_x_, slope_y_, height_;
  double steepness_;
};

}  // namespace

void HeightDifference::Begin(const TileMesh& mesh, std::span<const TileTriangle> tile,
                             const Grid& grid, const MeasureOptions& options) {
  border_plane_ = options.border;
  const auto [triangles, errors, local] = LoadTile(mesh, tile, options.surface, grid);
  raster_.Clear();
  if (raster_.Build(triangles, positions_, errors)) return;
  std::vector<uint32_t> opposites;
  PairHalfEdges(triangles, static_cast<uint32_t>(positions_.size()), opposites);
  round_.Build(triangles, opposites, positions_, errors);
}

void HeightDifference::Open(Hole& hole) {
  Close();
  if (hole.boundary) MeasureBorder(hole);
  double area = 0;
  for (uint32_t i = 0; i < hole.star.size(); ++i) {
    area += Hole::Side(hole.apex, hole.positions[i], hole.positions[i + 1 == hole.k ? 0 : i + 1]);
  }
  hole.LookAlong({0, 0, 1}, area);
  if (hole.boundary && border_plane_ != nullptr) MeasureMovedBorder(hole);
}

// The curve of the new border edge is the chain of border vertices removed between its ends; the
// accumulated error along it is that of the vertices on it.
void HeightDifference::MeasureBorder(Hole& hole) const {
  double error = 0;
  ForEachOnNewBorder(hole, [&](uint32_t w) {
    error =
        std::max(error, vertex_error(w) + HeightOverEdge(positions_[w], hole.positions[hole.k - 1],
                                                         hole.positions[0]));
  });
  hole.edge_error[0][hole.k - 1] = error;
}

// True when the new border edge cuts off the vertex alone, seen along z.
bool HeightDifference::MovesInwards(const Hole& hole) const {
  const Vec3d a = hole.positions[hole.k - 1];
  const Vec3d b = hole.positions[0];
  if (!(Hole::Side(a, b, hole.apex) < 0)) return false;
  for (uint32_t i = 1; i + 1 < hole.k; ++i) {
    if (!(Hole::Side(a, b, hole.positions[i]) > 0)) return false;
  }
  return true;
}

// As MeasureBorder, where vertices have gone that are not on the edge.
void HeightDifference::MeasureMovedBorder(Hole& hole) {
  GatherSamples(hole);
  const Vec3d a = hole.positions[hole.k - 1];
  const Vec3d b = hole.positions[0];
  double away = 0;
  bool straight = true;
  const auto look = [&](uint32_t w) {
    if (Hole::Side(a, b, positions_[w]) == 0) return;
    straight = false;
    const BorderPlane& plane = *border_plane_;
    const double squared =
        SquaredDistancePointSegment(plane.Place(positions_[w]), plane.Place(a), plane.Place(b));
    away = std::max(away, std::sqrt(squared) + vertex_error(w));
  };
  ForEachOnNewBorder(hole, look);
  for (const uint32_t w : samples_) {
    if (Hole::Side(a, b, positions_[w]) < 0) look(w);
  }
  double& error = hole.edge_error[0][hole.k - 1];
  if (straight) return;
  if (Hole::Side(a, b, hole.apex) == 0) {
    // Both edges together, but for their heights at the vertex.
    error = HeightOverEdge(hole.apex, a, b) +
            std::max(edge_error(hole.border_out), edge_error(hole.border_in));
  } else {
    error = -1;
    if (MovesInwards(hole)) MeasureEdge(hole, 0, hole.k - 1);
  }
  if (error >= 0) error = std::max(error, away);
}

bool HeightDifference::Sees(const Hole& hole) const {
  if (!(hole.area > 0)) return false;
  if (!hole.boundary) return true;
  if (Hole::Side(hole.positions[hole.k - 1], hole.positions[0], hole.apex) == 0) return true;
  return border_plane_ != nullptr && hole.edge_error[0][hole.k - 1] >= 0;
}

// Curves are dear, so that those of diagonals that no filling uses are found only where they are
// cheap. Elsewhere a guess decides.
bool HeightDifference::PriceEdges(Hole& hole) {
  GatherSamples(hole);
  if (!IsFresh(hole)) {
    spread_.Set(points_, 1);
    GuessEdges(hole);
    return false;
  }
  MeasureOverSpokes<true>(hole);
  hole.ForEachDiagonal([&](uint32_t i, uint32_t j) {
    if (hole.edge_error[i][j] == kUnknown) MeasureEdge(hole, i, j);
  });
  return true;
}

void HeightDifference::MeasureEdges(Hole& hole, const Filling& filling,
                                    const Hole::PerEdge<bool>& known) const {
  for (uint32_t t = 1; t + 2 < hole.k; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    if (!known[i][j]) MeasureEdge(hole, i, j);
  }
}

void HeightDifference::MeasureEdge(Hole& hole, uint32_t i, uint32_t j) const {
  hole.edge_error[i][j] = raster_.empty()
                              ? round_.CurveError(hole.ring[i], hole.ring[j])
                              : raster_.CurveError(hole.positions[i], hole.positions[j]);
}

void HeightDifference::Measure(const Hole& hole, Filling& filling) {
  GatherSamples(hole);
  TakeEdgeErrors(hole, filling);
  ChargeSamples(hole, filling);
  filling.error = *std::max_element(filling.errors.begin(), filling.errors.begin() + (hole.k - 2));
}

// Each sample is charged to every triangle that it lies over, seen along z. Four at once, in
// binary32, find those that may be meant.
void HeightDifference::ChargeSamples(const Hole& hole, Filling& filling) {
  const size_t count = samples_.size();
  const size_t groups = (count + 3) / 4;
  spread_.Set(points_, 1);
  double high = 0;
  for (const float z : spread_.z) high = std::max<double>(high, std::abs(z));
  double size = 0;
  for (uint32_t i = 0; i < hole.k; ++i) {
    size = std::max({size, std::abs(hole.points[i].x), std::abs(hole.points[i].y)});
    high = std::max(high, std::abs(hole.points[i].z));
  }
  charges_.clear();
  const auto blur = static_cast<float>(1e-5 * size);
  for (uint32_t t = 0; t + 2 < hole.k; ++t) {
    const TriangleLanes lanes(hole, filling.triangles[t]);
    // How much of a height rounding may hide.
    const auto hidden = static_cast<float>(1e-5 * (high + lanes.steepness() * size));
    for (size_t g = 0; g < groups; ++g) {
      const Float4 x = Load4<Float4>(&spread_.x[4 * g]);
      const Float4 y = Load4<Float4>(&spread_.y[4 * g]);
      const Float4 inside = lanes.Inwards(x, y);
      const Float4 height = lanes.HeightAbove(x, y, Load4<Float4>(&spread_.z[4 * g]));
      for (size_t s = 4 * g; s < std::min(4 * g + 4, count); ++s) {
        const float inwards = inside[static_cast<int>(s - 4 * g)];
        if (!(inwards >= -blur)) continue;
        // Most lie over the triangle, and add nothing to its error.
        const double known = double{height[static_cast<int>(s - 4 * g)]} + hidden;
        if (inwards > blur && known + vertex_error(samples_[s]) <= filling.errors[t]) {
          charges_.push_back({static_cast<uint8_t>(t), static_cast<uint32_t>(s)});
        } else {
          Charge(hole, filling, t, static_cast<uint32_t>(s));
        }
      }
    }
  }
}

// Unless sample s lies beside triangle t.
void HeightDifference::Charge(const Hole& hole, Filling& filling, uint32_t t, uint32_t s) {
  const auto [i, m, j] = filling.triangles[t];
  const Vec3d p = points_[s];
  const Vec3d& a = hole.points[i];
  const Vec3d& b = hole.points[m];
  const Vec3d& c = hole.points[j];
  if (Hole::Side(a, b, p) < 0 || Hole::Side(b, c, p) < 0 || Hole::Side(c, a, p) < 0) return;
  filling.errors[t] =
      std::max(filling.errors[t], HeightOver(p, a, b, c) + vertex_error(samples_[s]));
  charges_.push_back({static_cast<uint8_t>(t), s});
}

void HeightDifference::HandOn(const Hole& hole, const Filling& filling, uint32_t first) {
  uint32_t new_chain = kNone32;
  if (hole.boundary) {
    new_chain = JoinBorderChains(hole);
    // And what a border that moves leaves outside.
    for (const uint32_t w : samples_) {
      if (border_plane_ == nullptr) break;
      if (Hole::Side(hole.positions[hole.k - 1], hole.positions[0], positions_[w]) >= 0) continue;
      next_on_chain_[w] = new_chain;
      new_chain = w;
    }
  }
  Add(hole, filling, first, new_chain, charges_);
}

}  // namespace mtdb::internal
