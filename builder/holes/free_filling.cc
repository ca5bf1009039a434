// SPDX-License-Identifier: Apache-2.0
#include "builder/holes/free_filling.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace mtdb::internal {

namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Of collinear points: what rounding leaves of a triangle's area, by its squared edges.
constexpr double kNoArea = 1e-13;

// How well a triangle is shaped: its squared area over the square of its summed squared edges, 1
// for an equilateral one.
double Shape(Vec3d a, Vec3d b, Vec3d c, Vec3d cross) {
  const double edges = SquaredLength(b - a) + SquaredLength(c - b) + SquaredLength(a - c);
  return edges > 0 ? 12 * SquaredLength(cross) / (edges * edges) : 0;
}
}  // namespace

void FreeFilling::Open(const Hole& hole) {
  if (hole.folded) {
    SetFoldedCosts(hole);
  } else {
    SetSeenCosts(hole);
  }
}

template <typename Cost>
void FreeFilling::SetCosts(uint32_t k, const Cost& cost) {
  size_t next = 0;
  for (uint32_t span = 2; span < k; ++span) {
    for (uint32_t i = 0; i + span < k; ++i) {
      for (uint32_t m = i + 1; m < i + span; ++m) costs_[next++] = cost(i, m, i + span);
    }
  }
}

void FreeFilling::SetSeenCosts(const Hole& hole) {
  const uint32_t k = hole.k;
  // How far the vertex stands out of its ring: the scale at which shapes may matter.
  double height = 0;
  for (uint32_t i = 0; i < k; ++i) height += Dot(hole.positions[i] - hole.apex, hole.normal);
  const double weight = 0.05 * height * height / (k * k) + 1e-9 * hole.area;
  Hole::PerEdge<double> length2;
  for (uint32_t i = 0; i < k; ++i) {
    for (uint32_t j = i + 1; j < k; ++j) {
      Vec3d edge = hole.points[j] - hole.points[i];
      if (hole.flat) edge.z = 0;
      length2[i][j] = SquaredLength(edge);
    }
  }
  SetCosts(k, [&](uint32_t i, uint32_t m, uint32_t j) {
    const double a = length2[i][m];
    const double b = length2[m][j];
    const double c = length2[i][j];
    const double sum = a + b + c;
    if (!(Hole::Side(hole.points[i], hole.points[m], hole.points[j]) > kNoArea * sum)) {
      return kInfinity;
    }
    // 0 for an equilateral triangle, 1 for one without area (Heron).
    return weight * (6 * (a * a + b * b + c * c) / (sum * sum) - 2);
  });
}

void FreeFilling::SetFoldedCosts(const Hole& hole) {
  double size2 = 0;
  for (uint32_t i = 0; i < hole.k; ++i) {
    size2 = std::max(size2, SquaredLength(hole.positions[i] - hole.apex));
  }
  SetCosts(hole.k, [&](uint32_t i, uint32_t m, uint32_t j) {
    const Vec3d a = hole.positions[i];
    const Vec3d b = hole.positions[m];
    const Vec3d c = hole.positions[j];
    const Vec3d cross = Cross(b - a, c - a);
    const double turned = Dot(cross, hole.normal) > 0 ? 0 : 1e6;
    return size2 * (1 - Shape(a, b, c, cross) + turned) +
           SquaredDistancePointTriangle(hole.apex, a, b, c);
  });
}

// Dynamic programming over all triangulations.
bool FreeFilling::Fill(const Hole& hole, Hole::Triangles& triangles) const {
  const uint32_t k = hole.k;
  const double* cost = costs_.data();
  Hole::PerEdge<double> best;
  Hole::PerEdge<uint8_t> apex;
  for (uint32_t i = 0; i + 1 < k; ++i) best[i][i + 1] = 0;
  for (uint32_t span = 2; span < k; ++span) {
    for (uint32_t i = 0; i + span < k; ++i) {
      const uint32_t j = i + span;
      const double* costs = cost;
      cost += span - 1;
      const bool closing = span == k - 1;  // the ring's own edge, or the new border edge
      double least = kInfinity;
      uint32_t at = 0;
      if (closing || !(hole.forbidden[i][j] || hole.edge_error[i][j] < 0)) {
        for (uint32_t m = i + 1; m < j; ++m) {
          const double total = best[i][m] + best[m][j] + *costs++;
          at = total < least ? m : at;
          least = total < least ? total : least;
        }
      }
      apex[i][j] = static_cast<uint8_t>(at);
      // That of an edge which may not be used means nothing.
      const bool priced = least < kInfinity && (!closing || hole.boundary);
      const double e = priced ? hole.edge_error[i][j] : 0;
      best[i][j] = least + e * e;
    }
  }
  if (!(best[0][k - 1] < kInfinity)) return false;
  uint32_t count = 0;
  std::array<std::pair<uint8_t, uint8_t>, 2 * Hole::kMaxRing> stack;
  uint32_t depth = 0;
  stack[depth++] = {0, static_cast<uint8_t>(k - 1)};
  while (depth > 0) {
    const auto [i, j] = stack[--depth];
    if (j - i < 2) continue;
    const uint8_t m = apex[i][j];
    triangles[count++] = {i, m, j};
    stack[depth++] = {i, m};
    stack[depth++] = {m, j};
  }
  return true;
}

}  // namespace mtdb::internal
