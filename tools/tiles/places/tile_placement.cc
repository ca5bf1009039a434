// SPDX-License-Identifier: Apache-2.0
#include "tools/tiles/places/tile_placement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "store/metres_of_unit.h"
#include "tools/request/mesh_output.h"

namespace mtdb {

namespace {

constexpr double kHalfDiagonal = 0.8660254037844387;  // of a cube of side 1
constexpr int kFinestBits = 24;  // of a lattice of what has no grid: float32 counts so far

using Rows = std::array<Vec3d, 3>;

Vec3d Times(const Rows& m, Vec3d p) { return {Dot(m[0], p), Dot(m[1], p), Dot(m[2], p)}; }

// The least turn that takes `up` to z.
Rows TurnToZ(Vec3d up) {
  const Vec3d v = Cross(up, Vec3d{0, 0, 1});
  const double c = up.z;
  if (c < -1 + 1e-12) return {Vec3d{1, 0, 0}, Vec3d{0, -1, 0}, Vec3d{0, 0, -1}};
  const double k = 1 / (1 + c);
  return {Vec3d{v.x * v.x * k + c, v.x * v.y * k - v.z, v.x * v.z * k + v.y},
          Vec3d{v.y * v.x * k + v.z, v.y * v.y * k + c, v.y * v.z * k - v.x},
          Vec3d{v.z * v.x * k - v.y, v.z * v.y * k + v.x, v.z * v.z * k + c}};
}

std::array<Vec3d, 8> CornersOf(const Box3d& box) {
  std::array<Vec3d, 8> corners;
  for (size_t i = 0; i < corners.size(); ++i) {
    corners[i] = {(i & 1) != 0 ? box.max.x : box.min.x, (i & 2) != 0 ? box.max.y : box.min.y,
                  (i & 4) != 0 ? box.max.z : box.min.z};
  }
  return corners;
}

double MetresOfLength(const std::string& unit) {
  constexpr std::pair<std::string_view, double> kMetres[] = {
      {"um", 1e-6}, {"mm", 1e-3}, {"cm", 1e-2}, {"km", 1e3}, {"in", 0.0254}, {"ft", 0.3048}};
  for (const auto& [name, metres] : kMetres) {
    if (unit == name) return metres;
  }
  return 1;
}

}  // namespace

bool IsInDegrees(const ObjectRecord& record) {
  return MetresOfUnit(record) != std::array<double, 2>{1, 1};
}

double MetresOf(const ObjectRecord& record) {
  if (!IsInDegrees(record)) return MetresOfLength(record.units);
  const MeshWriteOptions options = MeshOptionsOf(record, false);
  return options.up_frame ? options.up_frame->metres.z : 1;
}

TilePlacement::TilePlacement(const ObjectRecord& record, const std::optional<GlobePlace>& at)
    : in_degrees_(IsInDegrees(record)), metres_(MetresOf(record)), at_(at) {
  const Box3d& b = record.bounds;
  if (in_degrees_) {
    frame_.emplace(GlobePlace{(b.min.x + b.max.x) / 2, (b.min.y + b.max.y) / 2, 0});
    latitude_ = std::max(std::abs(b.min.y), std::abs(b.max.y));
  } else if (at) {
    frame_.emplace(*at);
  }
  if (record.up && record.error_measure == ErrorMeasure::kTwoSidedDistance) {
    up_ = record.up->direction;
  }
  bounds_ = PlacedBounds(b);
  on_grid_ = !in_degrees_ && record.grid.mode == PositionMode::kGrid;
  if (on_grid_) {
    origin_ = record.grid.origin * metres_;
    least_step_ = record.grid.step * metres_;
    return;
  }
  origin_ = bounds_.min;
  const Vec3d extent = bounds_.max - bounds_.min;
  const double size = std::max({extent.x, extent.y, extent.z, 1e-30});
  least_step_ = std::exp2(std::ceil(std::log2(size)) - kFinestBits);
  // Heights of rasters lie on steps: a quarter of one is fine enough.
  if (record.grid.mode == PositionMode::kRaster) {
    least_step_ = std::max(least_step_, record.grid.step * metres_ / 4);
  }
}

Vec3d TilePlacement::Place(Vec3d p) const {
  if (!in_degrees_) return p * metres_;
  return frame_->FromEarth(EarthCentred({p.x, p.y, p.z * metres_}));
}

Vec3d TilePlacement::Unplace(Vec3d p) const {
  if (!in_degrees_) return p * (1 / metres_);
  const GlobePlace place = PlaceOnGlobe(frame_->origin + frame_->ToEarth(p));
  return {place.longitude, place.latitude, place.height / metres_};
}

// Of a terrain in degrees: around places of its border and middle, and what bulges between them.
Box3d TilePlacement::PlacedBounds(const Box3d& box) const {
  Box3d placed;
  if (!in_degrees_) {
    placed.Add(box.min * metres_);
    placed.Add(box.max * metres_);
    return placed;
  }
  constexpr int kParts = 32;
  for (int i = 0; i <= kParts; ++i) {
    for (int j = 0; j <= kParts; ++j) {
      for (const double z : {box.min.z, box.max.z}) {
        placed.Add(Place({box.min.x + (box.max.x - box.min.x) * i / kParts,
                          box.min.y + (box.max.y - box.min.y) * j / kParts, z}));
      }
    }
  }
  const Vec3d bulge = (placed.max - placed.min) * 1e-3;
  return {placed.min - bulge, placed.max + bulge};
}

double TilePlacement::StepFor(double rounding) const {
  double step = least_step_;
  while (step * 2 * kHalfDiagonal <= rounding) step *= 2;
  return step;
}

// A map of second derivatives of at most m, per unit of length squared, leaves its interpolation
// over a triangle by at most m L^2 / 6 or less, L the longest edge. On the ellipsoid m is the
// curvature, 1 / R, and along a parallel tan(latitude) / R more.
double TilePlacement::Bend(const LevelMesh& mesh) const {
  if (!in_degrees_) return 0;
  double longest = 0;
  const Status visited = mesh.Visit([&](std::span<const LevelTriangle> triangles) {
    for (const LevelTriangle& t : triangles) {
      const Triangle3d c = mesh.Corners(t);
      longest = std::max({longest, SquaredLength(c[1] - c[0]), SquaredLength(c[2] - c[1]),
                          SquaredLength(c[0] - c[2])});
    }
    return Status::Ok();
  });
  MTDB_CHECK(visited.ok(), "measuring does not fail");
  const double polar_radius = kEarthRadius * (1 - kEarthFlattening) * (1 - kEarthFlattening);
  return longest * (1 + std::tan(std::min(latitude_, 89.0) * kRadOfDegree)) / (6 * polar_radius);
}

std::optional<Json> TilePlacement::Transform() const {
  Rows turn = TurnToZ(up_);
  Vec3d moved;
  if (at_) {
    Box3d turned;
    for (const Vec3d& corner : CornersOf(bounds_)) turned.Add(Times(turn, corner));
    moved = Vec3d{(turned.min.x + turned.max.x) / -2, (turned.min.y + turned.max.y) / -2,
                  -turned.min.z};
  }
  std::array<Vec3d, 4> columns;
  for (int i = 0; i < 3; ++i) {
    Vec3d axis;
    axis[i] = 1;
    columns[static_cast<size_t>(i)] = Times(turn, axis);
  }
  columns[3] = moved;
  if (frame_) {
    for (Vec3d& column : columns) column = frame_->ToEarth(column);
    columns[3] += frame_->origin;
  } else if (up_ == Vec3d{0, 0, 1}) {
    return std::nullopt;
  }
  Json matrix(Json::Array{});
  for (size_t i = 0; i < columns.size(); ++i) {
    for (int c = 0; c < 3; ++c) matrix.push_back(columns[i][c]);
    matrix.push_back(i == 3 ? 1 : 0);
  }
  return matrix;
}

}  // namespace mtdb
