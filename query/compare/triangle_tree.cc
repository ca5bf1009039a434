// SPDX-License-Identifier: Apache-2.0
#include "query/compare/triangle_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "query/ask/probe_geometry.h"
#include "query/fields/rounding.h"

namespace mtdb::internal {
namespace {

std::vector<Box3d> BoxesOf(const std::vector<Triangle3d>& triangles) {
  std::vector<Box3d> boxes;
  boxes.reserve(triangles.size());
  for (const Triangle3d& t : triangles) boxes.push_back(Around(t));
  return boxes;
}

}  // namespace

// Any point q of a triangle bounds the distance from above, however well it was chosen. From below
// the plane through q across p - q does: no point of the triangle is nearer to p than the nearest
// corner is along p - q (weak duality). Where q is the closest point, both are one number; in a
// needle, where rounding misplaces q, they are two.
struct TriangleTree::Search {
  const Vec3d p;
  double high2 = std::numeric_limits<double>::infinity();
  double low2 = high2;
  uint32_t best = 0;

  void Look(const Triangle3d& t, uint32_t place) {
    const Vec3d away = p - ClosestPointOfTriangle(p, t);
    const double d2 = SquaredLength(away);
    const double along = std::min({Dot(away, p - t[0]), Dot(away, p - t[1]), Dot(away, p - t[2])});
    low2 = std::min(low2, along > 0 ? along * along / d2 : 0);
    if (d2 >= high2) return;
    high2 = d2;
    best = place;
  }
};

TriangleTree::TriangleTree(std::vector<Triangle3d> triangles, double outward)
    : TriangleTree(triangles, BoxesOf(triangles), outward) {}

TriangleTree::TriangleTree(std::vector<Triangle3d> triangles, std::vector<Box3d> boxes,
                           double outward)
    : boxes_(boxes), outward_(outward) {
  triangles_.reserve(triangles.size());
  for (const uint32_t i : boxes_.order()) triangles_.push_back(triangles[i]);
}

TriangleTree::Near TriangleTree::Nearest(Vec3d p, uint32_t hint) const {
  Search search{p};
  if (empty()) return {search.low2, search.high2};
  if (hint < triangles_.size()) search.Look(triangles_[hint], hint);
  boxes_.VisitNear([&](const Box3d& box) { return SquaredDistancePointBox(p, box); }, search.high2,
                   [&](uint32_t first, uint32_t last) {
                     for (uint32_t i = first; i < last; ++i) search.Look(triangles_[i], i);
                   });
  // What was not visited is no nearer than the best.
  const double low = std::sqrt(std::min(search.low2, search.high2)) - outward_;
  return {std::max(0.0, low), std::sqrt(search.high2) + outward_, search.best};
}

double TriangleTree::High(Vec3d p, uint32_t triangle) const {
  if (empty()) return std::numeric_limits<double>::infinity();
  return Length(p - ClosestPointOfTriangle(p, triangles_[triangle])) + outward_;
}

}  // namespace mtdb::internal
