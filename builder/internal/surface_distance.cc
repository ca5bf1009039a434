// SPDX-License-Identifier: Apache-2.0
#include "builder/internal/surface_distance.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "store/base/float4.h"

namespace mtdb::internal {

namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kUnknown = -2;      // of a diagonal's error
constexpr double kSlack = 1e-9;      // of a hole's size: what rounding may move a sample by
constexpr double kFirstGuess = 0.4;  // of a vertex's error, by its height over its neighbours

// The next larger float than that nearest to x, which is at least 0.
float RoundedUp(double x) {
  return std::bit_cast<float>(std::bit_cast<uint32_t>(static_cast<float>(x)) + 1);
}

// The nearest triangle of a filling, and the square of its distance.
std::pair<uint32_t, double> Nearest(const Hole& hole, const Hole::Triangles& triangles, Vec3d p) {
  uint32_t nearest = 0;
  double least = kInfinity;
  for (uint32_t t = 0; t < hole.k - 2; ++t) {
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

// Bounds the two-sided distance between filling and star by a correspondence: the vertex goes to
// its nearest triangle (of a border vertex: to the new border edge, which is triangle 0's), and a
// diagonal is crossed by the spokes to the ring vertices on its far side.
double DistanceToStar(const Hole& hole, const Hole::Triangles& triangles) {
  const uint32_t k = hole.k;
  const auto [home, nearest] =
      hole.boundary ? std::pair(0u, SquaredDistancePointSegment(hole.apex, hole.positions[0],
                                                                hole.positions[k - 1]))
                    : Nearest(hole, triangles, hole.apex);
  double distance2 = nearest;
  const auto [hi, hm, hj] = triangles[home];
  for (uint32_t t = 1; t < k - 2; ++t) {  // triangle t hangs on the diagonal (i, j)
    const auto [i, m, j] = triangles[t];
    const bool home_between = hi >= i && hj <= j;  // the ring positions i..j hold the home triangle
    for (uint32_t r = 0; r < k; ++r) {
      const bool between = r > i && r < j;
      if (r == i || r == j || between == home_between) continue;
      distance2 =
          std::max(distance2, SquaredDistanceSegmentSegment(hole.apex, hole.positions[r],
                                                            hole.positions[i], hole.positions[j]));
    }
  }
  return std::sqrt(distance2);
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

template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::Load(const TileMesh& mesh, std::span<const TileTriangle> tile,
                                 const TileSurface* surface, const Grid& grid) {
  mesh_ = &mesh;
  const size_t n = tile.size();
  triangles_.assign(n, Triangle{});
  for (size_t t = 0; t < n; ++t) {
    triangles_[t].error = tile[t].error;
    triangles_[t].curve_errors.fill(tile[t].error);
    triangles_[t].own = true;
  }
  positions_.clear();
  for (uint32_t v = 0; v < mesh.vertices(); ++v) positions_.push_back(mesh.position(v));
  held_.clear();
  held_in_use_ = 0;
  if (surface != nullptr && !surface->empty()) {
    LoadSurface(*surface, grid);
    MeasureHeights();
  } else {
    heights_.clear();
    if (kIsVertical) MeasureHeights();
    next_on_chain_.assign(positions_.size(), kNone32);
    BuildSurface(mesh.input_corners(), errors(), mesh.input_opposites());
  }
  // A curve bounds both of its triangles' parts.
  const std::span<const uint32_t> opposites = mesh.input_opposites();
  for (uint32_t h = 0; h < 3 * n; ++h) {
    const uint32_t o = opposites[h];
    if (o == kNone32 || o < h) continue;
    double& error = triangles_[h / 3].curve_errors[h % 3];
    double& twin_error = triangles_[o / 3].curve_errors[o % 3];
    error = twin_error = std::max(error, twin_error);
    float& reach = triangles_[h / 3].curve_reaches[h % 3];
    float& twin_reach = triangles_[o / 3].curve_reaches[o % 3];
    reach = twin_reach = std::max(reach, twin_reach);
  }
  opened_in_.assign(positions_.size(), 0);
  opened_ = 0;
}

// The surface's triangles are the tile's own ones and those of `surface`, in the mesh's numbering
// of vertices, which others follow.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::LoadSurface(const TileSurface& surface, const Grid& grid) {
  for (size_t t = 0; t < triangles_.size(); ++t) {
    Triangle& triangle = triangles_[t];
    triangle.own = surface.own[t] != 0;
    triangle.conservative = surface.conservative[t] != 0;
    for (size_t c = 0; c < 3; ++c) {
      triangle.curve_errors[c] = surface.curve_errors[t][c];
      triangle.curve_reaches[c] = surface.curve_reaches[t][c];
    }
  }
  const std::vector<uint32_t> number = NumberVertices(surface, mesh_->vertex_numbers());
  for (size_t v = 0; v < number.size(); ++v) {
    if (number[v] < mesh_->vertices()) continue;
    positions_.push_back(grid.is_linear() ? ToDouble(surface.positions[v])
                                          : grid.Position(surface.positions[v]));
  }
  std::vector<std::array<uint32_t, 3>> triangles;
  std::vector<float> errors;
  for (uint32_t t = 0; t < triangles_.size(); ++t) {
    if (!triangles_[t].own) continue;
    triangles.push_back(mesh_->corners(t));
    errors.push_back(triangles_[t].error);
  }
  for (size_t t = 0; t < surface.triangles.size(); ++t) {
    const auto [a, b, c] = surface.triangles[t];
    triangles.push_back({number[a], number[b], number[c]});
    errors.push_back(surface.errors[t]);
  }
  BuildSurface(triangles, errors, {});
  next_on_chain_.assign(positions_.size(), kNone32);
  std::vector<std::pair<uint32_t, uint32_t>> inside;
  for (const HeldVertex& held : surface.held) {
    if (held.edge == 3) {
      inside.push_back({held.triangle, number[held.vertex]});
      continue;
    }
    uint32_t& head = triangles_[held.triangle].chain_heads[held.edge];
    next_on_chain_[number[held.vertex]] = head;
    head = number[held.vertex];
  }
  HoldIn(0, static_cast<uint32_t>(triangles_.size()), inside);
}

// `opposites`: of half-edges, or empty.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::BuildSurface(std::span<const std::array<uint32_t, 3>> triangles,
                                         std::span<const float> errors,
                                         std::span<const uint32_t> opposites) {
  raster_.Clear();
  if (kIsVertical && raster_.Build(triangles, positions_, errors)) return;
  std::vector<uint32_t> found;
  if (opposites.empty()) {
    PairHalfEdges(triangles, static_cast<uint32_t>(positions_.size()), found);
    opposites = found;
  }
  round_.Build(triangles, opposites, positions_, errors);
}

template <ErrorMeasure kKind>
template <typename Items>
void SurfaceMeasure<kKind>::HoldIn(uint32_t first, uint32_t triangles, const Items& items) {
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
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::FreeHeld(std::span<const uint32_t> triangles) {
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

// How far the mesh's vertices stand off the mean of their neighbours, along the mean normal.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::MeasureHeights() {
  const uint32_t vertices = mesh_->vertices();
  std::vector<Vec3d> sums(vertices);
  std::vector<Vec3d> normals(vertices);
  std::vector<uint32_t> counts(vertices, 0);
  for (const auto& t : mesh_->input_corners()) {
    const Vec3d a = positions_[t[0]];
    const Vec3d b = positions_[t[1]];
    const Vec3d c = positions_[t[2]];
    const Vec3d normal = Cross(b - a, c - a);
    for (const uint32_t v : t) {
      sums[v] += a + b + c - positions_[v] * 3;
      normals[v] += normal;
      counts[v] += 2;
    }
  }
  heights_.assign(vertices, 0);
  for (uint32_t v = 0; v < vertices; ++v) {
    if (kIsVertical) {
      heights_[v] = std::abs(sums[v].z) / counts[v];
      continue;
    }
    const double length = Length(normals[v]);
    if (length > 0) heights_[v] = std::abs(Dot(sums[v], normals[v])) / (length * counts[v]);
  }
}

template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::Hold(TileResult& result) const {
  result.conservative.reserve(triangles_.size());
  result.curve_errors.reserve(3 * triangles_.size());
  result.curve_reaches.reserve(3 * triangles_.size());
  for (uint32_t t = 0; t < triangles_.size(); ++t) {
    result.conservative.push_back(triangles_[t].conservative);
    for (size_t c = 0; c < 3; ++c) {
      result.curve_errors.push_back(RoundedUp(triangles_[t].curve_errors[c]));
      result.curve_reaches.push_back(triangles_[t].curve_reaches[c]);
    }
    if (!result.alive[t]) continue;
    for (const uint32_t w : HeldBy(t)) result.held.push_back({w, t, 3});
    for (uint32_t c = 0; c < 3; ++c) {
      for (uint32_t w = triangles_[t].chain_heads[c]; w != kNone32; w = next_on_chain_[w]) {
        result.held.push_back({w, t, c});
      }
    }
  }
}

template <ErrorMeasure kKind>
std::vector<float> SurfaceMeasure<kKind>::errors() const {
  std::vector<float> errors;
  errors.reserve(triangles_.size());
  for (const Triangle& t : triangles_) errors.push_back(t.error);
  return errors;
}

template <ErrorMeasure kKind>
double SurfaceMeasure<kKind>::FirstGuess(uint32_t v) const {
  return kFirstGuess * (heights_.empty() ? round_.Height(v) : heights_[v]) + vertex_error(v);
}

template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::Open(Hole& hole) {
  if (hole.boundary) MeasureBorder(hole);
  hole.flat = kIsVertical;
  gathered_ = false;
  if (kIsVertical) {
    double area = 0;
    for (uint32_t i = 0; i < hole.star.size(); ++i) {
      area += Hole::Side(hole.apex, hole.positions[i], hole.positions[i + 1 == hole.k ? 0 : i + 1]);
    }
    hole.LookAlong({0, 0, 1}, area);
    if (hole.boundary && border_plane_ != nullptr) MeasureMovedBorder(hole);
    return;
  }
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

// When they are first asked for.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::GatherSamples(const Hole& hole) {
  if (std::exchange(gathered_, true)) return;
  samples_.clear();
  ++opened_;
  for (const uint32_t v : hole.ring) opened_in_[v] = opened_;
  for (const uint32_t t : hole.star) {
    for (const uint32_t w : HeldBy(t)) {
      if (std::exchange(opened_in_[w], opened_) != opened_) samples_.push_back(w);
    }
  }
  if (!hole.boundary) samples_.push_back(hole.vertex);
  points_.clear();
  sample_errors_.clear();
  for (const uint32_t w : samples_) {
    points_.push_back(hole.InFrame(positions_[w]));
    sample_errors_.push_back(static_cast<float>(vertex_error(w) * (1 + 1e-6)));
  }
}

// True when the new border edge cuts off the vertex alone, seen along z.
template <ErrorMeasure kKind>
bool SurfaceMeasure<kKind>::MovesInwards(const Hole& hole) const {
  const Vec3d a = hole.positions[hole.k - 1];
  const Vec3d b = hole.positions[0];
  if (!(Hole::Side(a, b, hole.apex) < 0)) return false;
  for (uint32_t i = 1; i + 1 < hole.k; ++i) {
    if (!(Hole::Side(a, b, hole.positions[i]) > 0)) return false;
  }
  return true;
}

// As MeasureBorder, where vertices have gone that are not on the edge.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::MeasureMovedBorder(Hole& hole) {
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
  look(hole.vertex);
  for (const uint32_t h : {hole.border_out, hole.border_in}) {
    for (uint32_t w = chain_head(h); w != kNone32; w = next_on_chain_[w]) look(w);
  }
  for (const uint32_t w : samples_) {
    if (Hole::Side(a, b, positions_[w]) < 0) look(w);
  }
  double& error = hole.edge_error[0][hole.k - 1];
  if (straight) return;
  if (Hole::Side(a, b, hole.apex) == 0) {
    // Both edges together, but for their heights at the vertex.
    error = HeightOverEdge(hole.apex, a, b) +
            std::max(curve_error(hole.border_out), curve_error(hole.border_in));
  } else {
    error = -1;
    if (MovesInwards(hole)) MeasureEdge(hole, 0, hole.k - 1);
  }
  if (error >= 0) error = std::max(error, away);
}

// The curve of the new border edge is the chain of border vertices removed between its ends; the
// accumulated error along it is that of the vertices on it.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::MeasureBorder(Hole& hole) const {
  const Vec3d a = hole.positions[hole.k - 1];
  const Vec3d b = hole.positions[0];
  double error = 0;
  double reach = 0;
  const auto add = [&](uint32_t w) {
    const double distance = kIsVertical
                                ? HeightOverEdge(positions_[w], a, b)
                                : std::sqrt(SquaredDistancePointSegment(positions_[w], a, b));
    error = std::max(error, distance + vertex_error(w));
    reach = std::max(reach, distance);
  };
  add(hole.vertex);
  for (const uint32_t h : {hole.border_out, hole.border_in}) {
    for (uint32_t w = chain_head(h); w != kNone32; w = next_on_chain_[w]) add(w);
  }
  hole.edge_error[0][hole.k - 1] = error;
  hole.edge_reach[0][hole.k - 1] = RoundedUp(reach);
}

template <ErrorMeasure kKind>
bool SurfaceMeasure<kKind>::Sees(const Hole& hole) const {
  if (!(hole.area > 0)) return false;
  if (kIsVertical) {
    if (!hole.boundary) return true;
    if (Hole::Side(hole.positions[hole.k - 1], hole.positions[0], hole.apex) == 0) return true;
    return border_plane_ != nullptr && hole.edge_error[0][hole.k - 1] >= 0;
  }
  for (const uint32_t t : hole.star) {
    if (triangles_[t].conservative) return false;
  }
  for (const uint32_t w : samples_) {
    if (!round_.Faces(w, hole.normal)) return false;
  }
  return !hole.boundary || round_.Faces(hole.vertex, hole.normal);
}

template <ErrorMeasure kKind>
bool SurfaceMeasure<kKind>::IsFresh(const Hole& hole) const {
  return !hole.boundary && samples_.size() == 1 &&
         std::all_of(hole.star.begin(), hole.star.end(),
                     [&](uint32_t t) { return triangles_[t].own; });
}

// Curves are dear, so that those of diagonals that no filling uses are found only where they are
// cheap. Elsewhere a guess decides.
template <ErrorMeasure kKind>
bool SurfaceMeasure<kKind>::PriceEdges(Hole& hole) {
  GatherSamples(hole);
  if (!IsFresh(hole)) {
    GuessEdges(hole);
    return false;
  }
  MeasureOverSpokes(hole);
  hole.ForEachDiagonal([&](uint32_t i, uint32_t j) {
    if (hole.edge_error[i][j] == kUnknown) MeasureEdge(hole, i, j);
  });
  return true;
}

template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::MeasureEdge(Hole& hole, uint32_t i, uint32_t j) const {
  if (is_raster()) {
    hole.edge_error[i][j] = raster_.CurveError(hole.positions[i], hole.positions[j]);
    hole.edge_reach[i][j] = 0;
    return;
  }
  const RoundMesh::Curve curve =
      round_.CurveOf<kKind>(hole.ring[i], hole.ring[j], hole.normal, {opened_in_, opened_});
  hole.edge_error[i][j] = curve.error;
  hole.edge_reach[i][j] = RoundedUp(curve.reach);
}

// From the samples that lie near an edge.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::GuessEdges(Hole& hole) const {
  // Four points at once. More than these hardly change a guess.
  constexpr size_t kMost = 64;
  const size_t count = std::min(points_.size(), kMost);
  const size_t groups = (count + 3) / 4;
  std::array<float, kMost> x;
  std::array<float, kMost> y;
  std::array<float, kMost> z;
  for (size_t s = 0; s < 4 * groups; ++s) {
    const Vec3d& p = points_[std::min(s, count - 1)];
    x[s] = static_cast<float>(p.x);
    y[s] = static_cast<float>(p.y);
    z[s] = static_cast<float>(p.z);
  }
  hole.ForEachDiagonal([&](uint32_t i, uint32_t j) {
    // How far points near the edge's line stand off it; nearer ones count more.
    const Vec3d origin = hole.points[i];
    const Vec3d d = hole.points[j] - origin;
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
    for (size_t g = 0; g < groups; ++g) {
      const Float4 px = Load4<Float4>(&x[4 * g]) - ox;
      const Float4 py = Load4<Float4>(&y[4 * g]) - oy;
      const Float4 pz = Load4<Float4>(&z[4 * g]) - oz;
      const Float4 t = px * ux + py * uy;
      const Float4 side = px * uy - py * ux;
      const Float4 off = pz - t * dz;
      const Float4 value = (off < 0 ? -off : off) * (1 - 4 * side * side);
      most = Max4(most, ((t > 0) & (t < 1)) ? value : Float4{});
    }
    hole.edge_error[i][j] = std::max(std::max(most[0], most[1]), std::max(most[2], most[3]));
  });
}

// A diagonal's curve runs over the star in the plane along z. Diagonals that leave the star get
// kUnknown.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::MeasureOverSpokes(Hole& hole) const {
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
    double least = kInfinity;
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
      least = std::min(least, spoke_error[m]);
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
    hole.edge_reach[i][j] = RoundedUp(error - least);
  });
}

// Of the curve of a filling's edge, a < b.
template <ErrorMeasure kKind>
double SurfaceMeasure<kKind>::CurveError(const Hole& hole, uint32_t a, uint32_t b) const {
  if (b == a + 1) return curve_error(hole.ring_edges[a]);
  if (hole.OnRing(b, a)) return curve_error(hole.ring_edges[b]);
  return hole.edge_error[a][b];
}

// Curves alone.
template <ErrorMeasure kKind>
double SurfaceMeasure<kKind>::LowerBound(const Hole& hole, const Filling& filling) const {
  double bound = hole.boundary ? hole.edge_error[0][hole.k - 1] : 0;
  for (uint32_t t = 1; t < hole.k - 2; ++t) {
    bound = std::max(bound, hole.edge_error[filling.triangles[t][0]][filling.triangles[t][2]]);
  }
  for (const uint32_t h : hole.ring_edges) bound = std::max(bound, curve_error(h));
  return bound;
}

template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::Measure(const Hole& hole, Filling& filling) {
  GatherSamples(hole);
  const uint32_t count = hole.k - 2;
  for (uint32_t t = 0; t < count; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    filling.errors[t] =
        std::max({CurveError(hole, i, m), CurveError(hole, m, j), CurveError(hole, i, j)});
  }
  ChargeSamples(hole, filling);
  filling.error = 0;
  for (uint32_t t = 0; t < count; ++t) filling.error = std::max(filling.error, filling.errors[t]);
}

// How far the part of S that a triangle stands for may reach beyond it, seen along the normal: as
// far as the curves of its ring edges and of a new border edge. Those of diagonals lie over these.
template <ErrorMeasure kKind>
double SurfaceMeasure<kKind>::Reach(const Hole& hole, const Hole::Triangle& triangle) const {
  if (kIsVertical) return 0;
  float reach = 0;
  for (uint32_t c = 0; c < 3; ++c) {
    const auto [a, b] = Hole::Edge(triangle, c);
    if (hole.OnRing(a, b)) {
      const uint32_t h = hole.ring_edges[a];
      reach = std::max(reach, triangles_[h / 3].curve_reaches[h % 3]);
    }
    if (hole.IsNewBorder(a, b)) reach = std::max(reach, hole.edge_reach[b][a]);
  }
  return reach;
}

// Each sample is charged to every triangle whose part may hold it: to those that it lies over, or
// not farther beside than the part may reach.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::ChargeSamples(const Hole& hole, Filling& filling) {
  const size_t count = samples_.size();
  const size_t groups = (count + 3) / 4;
  x_.resize(4 * groups);
  y_.resize(4 * groups);
  z_.resize(4 * groups);
  double high = 0;
  for (size_t s = 0; s < 4 * groups; ++s) {
    const Vec3d& p = points_[std::min(s, count - 1)];
    x_[s] = static_cast<float>(p.x);
    y_[s] = static_cast<float>(p.y);
    z_[s] = static_cast<float>(p.z);
    high = std::max(high, std::abs(p.z));
  }
  double size = 0;
  for (uint32_t i = 0; i < hole.k; ++i) {
    size = std::max({size, std::abs(hole.points[i].x), std::abs(hole.points[i].y)});
    high = std::max(high, std::abs(hole.points[i].z));
  }
  charges_.clear();
  is_charged_.assign(count, 0);
  for (uint32_t t = 0; t + 2 < hole.k; ++t) {
    const Hole::Triangle& triangle = filling.triangles[t];
    const double reach = Reach(hole, triangle) + (kIsVertical ? 0 : kSlack * size);
    // Four samples at once, in binary32, find those that may be meant.
    const auto blur = static_cast<float>(1e-5 * size);
    const float allowed = static_cast<float>(reach) + blur;
    const TriangleLanes lanes(hole, triangle);
    // How much of a height rounding may hide.
    const auto hidden = static_cast<float>(1e-5 * (high + lanes.steepness() * size));
    for (size_t g = 0; g < groups; ++g) {
      const Float4 x = Load4<Float4>(&x_[4 * g]);
      const Float4 y = Load4<Float4>(&y_[4 * g]);
      const Float4 inside = lanes.Inwards(x, y);
      const Float4 height = lanes.HeightAbove(x, y, Load4<Float4>(&z_[4 * g]));
      for (size_t s = 4 * g; s < std::min(4 * g + 4, count); ++s) {
        const float inwards = inside[static_cast<int>(s - 4 * g)];
        if (!(inwards >= -allowed)) continue;
        // Most lie over the triangle, and add nothing to its error.
        const float known = height[static_cast<int>(s - 4 * g)] + hidden;
        if (inwards > blur && known + sample_errors_[s] <= filling.errors[t]) {
          charges_.push_back({static_cast<uint8_t>(t), static_cast<uint32_t>(s)});
          is_charged_[s] = 1;
        } else {
          Charge(hole, filling, t, static_cast<uint32_t>(s), reach);
        }
      }
    }
  }
  for (uint32_t s = 0; s < count; ++s) {
    if (is_charged_[s]) continue;  // beside all of them: only where curves are not what they seem
    const uint32_t t = Nearest(hole, filling.triangles, positions_[samples_[s]]).first;
    Charge(hole, filling, t, s, kInfinity);
  }
}

// Unless sample s lies farther beside triangle t than `reach`.
template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::Charge(const Hole& hole, Filling& filling, uint32_t t, uint32_t s,
                                   double reach) {
  const auto [i, m, j] = filling.triangles[t];
  const Vec3d p = points_[s];
  const Vec3d& a = hole.points[i];
  const Vec3d& b = hole.points[m];
  const Vec3d& c = hole.points[j];
  if (Hole::Side(a, b, p) < 0 || Hole::Side(b, c, p) < 0 || Hole::Side(c, a, p) < 0) {
    if (kIsVertical) return;
    const auto flat = [](Vec3d v) { return Vec3d{v.x, v.y, 0}; };
    if (SquaredDistancePointTriangle(flat(p), flat(a), flat(b), flat(c)) > reach * reach) return;
  }
  const double distance =
      kIsVertical ? HeightOver(p, a, b, c) : std::sqrt(SquaredDistancePointTriangle(p, a, b, c));
  filling.errors[t] = std::max(filling.errors[t], distance + vertex_error(samples_[s]));
  charges_.push_back({static_cast<uint8_t>(t), s});
  is_charged_[s] = 1;
}

template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::MeasureFolded(const Hole& hole, Filling& filling) {
  GatherSamples(hole);
  double star_error = 0;
  for (const uint32_t t : hole.star) {
    star_error = std::max<double>(star_error, triangles_[t].error);
    for (const double error : triangles_[t].curve_errors) star_error = std::max(star_error, error);
  }
  filling.error = DistanceToStar(hole, filling.triangles) + star_error;
  if (hole.boundary) filling.error = std::max(filling.error, hole.edge_error[0][hole.k - 1]);
  filling.errors.fill(filling.error);
  charges_.clear();
  for (uint32_t s = 0; s < samples_.size(); ++s) {
    const uint32_t t = Nearest(hole, filling.triangles, positions_[samples_[s]]).first;
    charges_.push_back({static_cast<uint8_t>(t), s});
  }
}

template <ErrorMeasure kKind>
void SurfaceMeasure<kKind>::HandOn(const Hole& hole, const Filling& filling, uint32_t first) {
  const uint32_t count = hole.k - 2;
  bool conservative = hole.folded;
  for (const uint32_t t : hole.star) conservative |= triangles_[t].conservative;
  const uint32_t new_chain = hole.boundary ? JoinBorderChains(hole) : kNone32;
  FreeHeld(hole.star);
  for (uint32_t t = 0; t < count; ++t) {
    Triangle made;
    made.error = RoundedUp(filling.errors[t]);
    made.conservative = conservative;
    for (uint32_t c = 0; c < 3; ++c) {
      const auto [a, b] = Hole::Edge(filling.triangles[t], c);
      if (hole.OnRing(a, b)) {  // takes over what the star's half-edge had
        const uint32_t h = hole.ring_edges[a];
        const Triangle& old = triangles_[h / 3];
        made.curve_errors[c] = old.curve_errors[h % 3];
        made.curve_reaches[c] = old.curve_reaches[h % 3];
        made.chain_heads[c] = old.chain_heads[h % 3];
      } else if (hole.IsNewBorder(a, b)) {
        made.curve_errors[c] = hole.edge_error[b][a];
        made.curve_reaches[c] = hole.edge_reach[b][a];
        made.chain_heads[c] = new_chain;
      } else {
        const auto [i, j] = std::minmax(a, b);
        made.curve_errors[c] = hole.folded ? filling.error : hole.edge_error[i][j];
        made.curve_reaches[c] = hole.edge_reach[i][j];
      }
    }
    triangles_.push_back(made);
  }
  for (auto& [triangle, s] : charges_) s = samples_[s];
  HoldIn(first, count, charges_);
}

// The new border edge's chain: both old ones and the vertex that goes.
template <ErrorMeasure kKind>
uint32_t SurfaceMeasure<kKind>::JoinBorderChains(const Hole& hole) {
  next_on_chain_[hole.vertex] = chain_head(hole.border_out);
  uint32_t tail = hole.vertex;
  while (next_on_chain_[tail] != kNone32) tail = next_on_chain_[tail];
  next_on_chain_[tail] = chain_head(hole.border_in);
  uint32_t head = hole.vertex;
  if (!kIsVertical || border_plane_ == nullptr) return head;
  // And what a border that moves leaves outside.
  for (const uint32_t w : samples_) {
    if (Hole::Side(hole.positions[hole.k - 1], hole.positions[0], positions_[w]) >= 0) continue;
    next_on_chain_[w] = head;
    head = w;
  }
  return head;
}

template class SurfaceMeasure<ErrorMeasure::kTwoSidedDistance>;
template class SurfaceMeasure<ErrorMeasure::kVertical>;

}  // namespace mtdb::internal
