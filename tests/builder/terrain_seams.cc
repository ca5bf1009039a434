// SPDX-License-Identifier: Apache-2.0
#include "tests/builder/terrain_seams.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mtdb::testing {

namespace {

using Triangle3 = std::array<Vec3d, 3>;

double HeightAt(const Triangle3& t, Vec3d p) {
  const double a = Hole::Side(t[1], t[2], p);
  const double b = Hole::Side(t[2], t[0], p);
  const double c = Hole::Side(t[0], t[1], p);
  return (a * t[0].z + b * t[1].z + c * t[2].z) / (a + b + c);
}

// The convex polygon that a and b have in common, seen from above.
std::vector<Vec3d> Common(const Triangle3& a, const Triangle3& b) {
  std::vector<Vec3d> polygon(a.begin(), a.end());
  for (size_t c = 0; c < 3 && !polygon.empty(); ++c) {
    const Vec3d from = b[c];
    const Vec3d to = b[(c + 1) % 3];
    std::vector<Vec3d> inside;
    for (size_t i = 0; i < polygon.size(); ++i) {
      const Vec3d p = polygon[i];
      const Vec3d q = polygon[(i + 1) % polygon.size()];
      const double sp = Hole::Side(from, to, p);
      const double sq = Hole::Side(from, to, q);
      if (sp >= 0) inside.push_back(p);
      if ((sp > 0 && sq < 0) || (sp < 0 && sq > 0))
        inside.push_back(p + (q - p) * (sp / (sp - sq)));
    }
    polygon = std::move(inside);
  }
  return polygon;
}

}  // namespace

double HeightDifference(const Triangle3& a, const Triangle3& b) {
  for (int axis = 0; axis < 2; ++axis) {
    const auto [a_least, a_most] = std::minmax({a[0][axis], a[1][axis], a[2][axis]});
    const auto [b_least, b_most] = std::minmax({b[0][axis], b[1][axis], b[2][axis]});
    if (a_least > b_most || b_least > a_most) return -1;
  }
  const std::vector<Vec3d> common = Common(a, b);
  double area = 0;
  double largest = -1;
  for (size_t i = 0; i + 2 < common.size(); ++i) {
    area += Hole::Side(common[0], common[i + 1], common[i + 2]);
  }
  if (!(area > 1e-6)) return -1;
  for (const Vec3d p : common) {
    largest = std::max(largest, std::abs(HeightAt(a, p) - HeightAt(b, p)));
  }
  return largest;
}

size_t VerticalMeasure::BinOf(double value, int axis) const {
  const double extent = std::max(max_[axis] - min_[axis], 1.0);
  const double bin = (value - min_[axis]) / extent * kBins;
  return static_cast<size_t>(std::clamp(bin, 0.0, kBins - 1.0));
}

void VerticalMeasure::Begin(const TileMesh& mesh, std::span<const TileTriangle> tile, const Grid&,
                            const MeasureOptions&) {
  input_.clear();
  errors_.clear();
  for (auto& bin : bins_) bin.clear();
  Box3d box;
  for (uint32_t t = 0; t < tile.size(); ++t) {
    errors_.push_back(tile[t].error);
    const auto& c = mesh.corners(t);
    input_.push_back({mesh.position(c[0]), mesh.position(c[1]), mesh.position(c[2])});
    for (const Vec3d p : input_.back()) box.Add(p);
  }
  min_ = box.min;
  max_ = box.max;
  for (uint32_t t = 0; t < input_.size(); ++t) {
    Box3d own;
    for (const Vec3d p : input_[t]) own.Add(p);
    for (size_t y = BinOf(own.min.y, 1); y <= BinOf(own.max.y, 1); ++y) {
      for (size_t x = BinOf(own.min.x, 0); x <= BinOf(own.max.x, 0); ++x) {
        bins_[y * kBins + x].push_back(t);
      }
    }
  }
}

void VerticalMeasure::Open(Hole& hole) {
  double area = 0;
  for (uint32_t i = 0; i < hole.k; ++i) {
    area += Hole::Side(hole.apex, hole.positions[i], hole.positions[(i + 1) % hole.k]);
  }
  hole.LookAlong({0, 0, 1}, area);
  if (hole.boundary) hole.edge_error[0][hole.k - 1] = 0;
}

bool VerticalMeasure::PriceEdges(Hole& hole) const {
  hole.ForEachDiagonal([&](uint32_t i, uint32_t j) { hole.edge_error[i][j] = 0; });
  return true;
}

void VerticalMeasure::Measure(const Hole& hole, Filling& filling) const {
  filling.error = 0;
  for (uint32_t t = 0; t < hole.k - 2; ++t) {
    const auto [i, m, j] = filling.triangles[t];
    const Triangle3 triangle = {hole.positions[i], hole.positions[m], hole.positions[j]};
    Box3d own;
    for (const Vec3d p : triangle) own.Add(p);
    filling.errors[t] = 0;
    for (size_t y = BinOf(own.min.y, 1); y <= BinOf(own.max.y, 1); ++y) {
      for (size_t x = BinOf(own.min.x, 0); x <= BinOf(own.max.x, 0); ++x) {
        for (const uint32_t input : bins_[y * kBins + x]) {
          const double difference = HeightDifference(triangle, input_[input]);
          if (difference < 0) continue;
          filling.errors[t] =
              std::max(filling.errors[t], difference + static_cast<double>(errors_[input]));
        }
      }
    }
    filling.error = std::max(filling.error, filling.errors[t]);
  }
}

void VerticalMeasure::HandOn(const Hole& hole, const Filling& filling, uint32_t first) {
  errors_.resize(first);
  for (uint32_t t = 0; t < hole.k - 2; ++t) {
    errors_.push_back(std::nextafter(static_cast<float>(filling.errors[t]),
                                     std::numeric_limits<float>::infinity()));
  }
}

namespace {

// 1 when abc runs counter-clockwise, -1 clockwise; ring points are integers, so that all of this is
// exact.
int Turn(Vec3d a, Vec3d b, Vec3d c) {
  const double area = Hole::Side(a, b, c);
  return area > 0 ? 1 : area < 0 ? -1 : 0;
}

// Positive when d lies inside the circle through a, b and c, which run counter-clockwise.
__extension__ using Wide = __int128;
int InCircle(Vec3d a, Vec3d b, Vec3d c, Vec3d d) {
  const auto row = [&](Vec3d p) {
    const auto x = static_cast<Wide>(p.x - d.x);
    const auto y = static_cast<Wide>(p.y - d.y);
    return std::array<Wide, 3>{x, y, x * x + y * y};
  };
  const auto [ax, ay, aw] = row(a);
  const auto [bx, by, bw] = row(b);
  const auto [cx, cy, cw] = row(c);
  const Wide det = ax * (by * cw - bw * cy) - ay * (bx * cw - bw * cx) + aw * (bx * cy - by * cx);
  return det > 0 ? 1 : det < 0 ? -1 : 0;
}

// True when ring positions i and j see each other within the polygon of i..j, m between them or
// an end.
bool SeesApex(const Hole& hole, uint32_t i, uint32_t m, uint32_t j) {
  const auto& p = hole.points;
  if (Turn(p[i], p[m], p[j]) <= 0) return false;
  const auto crosses = [&](uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    if (a == c || a == d || b == c || b == d) return false;
    return Turn(p[a], p[b], p[c]) * Turn(p[a], p[b], p[d]) <= 0 &&
           Turn(p[c], p[d], p[a]) * Turn(p[c], p[d], p[b]) <= 0;
  };
  for (uint32_t r = i; r < j; ++r) {
    if (crosses(i, m, r, r + 1) || crosses(m, j, r, r + 1)) return false;
  }
  for (uint32_t r = i + 1; r < j; ++r) {
    if (r == m) continue;
    if (Turn(p[i], p[m], p[r]) >= 0 && Turn(p[m], p[j], p[r]) >= 0 && Turn(p[j], p[i], p[r]) >= 0) {
      return false;
    }
  }
  return true;
}

}  // namespace

bool DelaunayFilling::Fill(const Hole& hole, Hole::Triangles& triangles) const {
  if (hole.folded) return false;
  uint32_t count = 0;
  std::vector<std::pair<uint32_t, uint32_t>> edges = {{0, hole.k - 1}};
  while (!edges.empty()) {
    const auto [i, j] = edges.back();
    edges.pop_back();
    if (j - i < 2) continue;
    if (i + 2 <= j && !(i == 0 && j == hole.k - 1) && hole.forbidden[i][j]) return false;
    // Of those that the edge sees, the apex whose circle holds no other one.
    uint32_t apex = kNone32;
    for (uint32_t m = i + 1; m < j; ++m) {
      if (!SeesApex(hole, i, m, j)) continue;
      if (apex == kNone32 ||
          InCircle(hole.points[i], hole.points[apex], hole.points[j], hole.points[m]) > 0) {
        apex = m;
      }
    }
    if (apex == kNone32) return false;
    triangles[count++] = {static_cast<uint8_t>(i), static_cast<uint8_t>(apex),
                          static_cast<uint8_t>(j)};
    edges.emplace_back(i, apex);
    edges.emplace_back(apex, j);
  }
  return true;
}

}  // namespace mtdb::testing
