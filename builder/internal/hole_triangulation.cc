#include "builder/internal/hole_triangulation.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "store/base/float4.h"

namespace mtdb {

namespace {
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Of collinear points: what rounding leaves of a triangle's area, by its squared edges.
constexpr double kNoArea = 1e-13;
}  // namespace

void HoleTriangulation::GuessEdgeErrors(std::span<const Vec3d> points) {
  // Four points at once. More than these hardly change a guess.
  constexpr size_t kMost = 64;
  const size_t count = std::min(points.size(), kMost);
  const size_t groups = (count + 3) / 4;
  std::array<float, kMost> x;
  std::array<float, kMost> y;
  std::array<float, kMost> z;
  for (size_t s = 0; s < 4 * groups; ++s) {
    const Vec3d& p = points[std::min(s, count - 1)];
    x[s] = static_cast<float>(p.x);
    y[s] = static_cast<float>(p.y);
    z[s] = static_cast<float>(p.z);
  }
  ForEachDiagonal([&](uint32_t i, uint32_t j) {
    // How far points near the edge's line stand off it; nearer ones count more.
    const Vec3d d = ring[j] - ring[i];
    const double length2 = d.x * d.x + d.y * d.y;
    if (!(length2 > 0)) {
      edge_error[i][j] = 0;
      return;
    }
    // Along the edge in units of its length; across it likewise.
    const auto ux = static_cast<float>(d.x / length2);
    const auto uy = static_cast<float>(d.y / length2);
    const auto dz = static_cast<float>(d.z);
    const auto ox = static_cast<float>(ring[i].x);
    const auto oy = static_cast<float>(ring[i].y);
    const auto oz = static_cast<float>(ring[i].z);
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
    edge_error[i][j] = std::max(std::max(most[0], most[1]), std::max(most[2], most[3]));
  });
}

void HoleTriangulation::MeasureEdgeErrors(Vec3d apex, std::span<const double> spoke_error) {
  ForEachDiagonal([&](uint32_t i, uint32_t j) {
    const Vec3d d = ring[j] - ring[i];
    const Vec3d to_apex = apex - ring[i];
    const double apex_side = d.x * to_apex.y - d.y * to_apex.x;
    const double length2 = SquaredLength(d);
    double& error = edge_error[i][j];
    error = 0;
    // The ring beyond the edge, seen from the apex.
    const bool left = apex_side >= 0;
    const uint32_t begin = left ? i + 1 : j + 1;
    const uint32_t end = left ? j : i + k;
    for (uint32_t r = begin; r < end; ++r) {
      const uint32_t m = r < k ? r : r - k;
      const Vec3d to_ring = ring[m] - ring[i];
      const double ring_side = d.x * to_ring.y - d.y * to_ring.x;
      if (left ? ring_side >= 0 : ring_side <= 0) {
        error = kUnknown;
        return;
      }
      // The crossing c; w * (c - ring[i]) needs no division.
      const double w = std::abs(apex_side - ring_side);
      const Vec3d wc = to_apex * w + (to_ring - to_apex) * std::abs(apex_side);
      const double t = Dot(wc, d);
      const Vec3d offset = t <= 0 ? wc : t >= length2 * w ? wc - d * w : wc - d * (t / length2);
      error = std::max(error, Length(offset) / w + spoke_error[m]);
    }
  });
}

void HoleTriangulation::SetShapeCosts(double weight) {
  std::array<std::array<double, kMaxRing>, kMaxRing> length2;
  for (uint32_t i = 0; i < k; ++i) {
    for (uint32_t j = i + 1; j < k; ++j) length2[i][j] = SquaredLength(ring[j] - ring[i]);
  }
  SetCosts([&](uint32_t i, uint32_t m, uint32_t j) {
    const double a = length2[i][m];
    const double b = length2[m][j];
    const double c = length2[i][j];
    const double sum = a + b + c;
    if (!(Side(ring[i], ring[m], ring[j]) > kNoArea * sum)) return kInfinity;
    // 0 for an equilateral triangle, 1 for one without area (Heron).
    return weight * (6 * (a * a + b * b + c * c) / (sum * sum) - 2);
  });
}

bool HoleTriangulation::Find(Triangles& triangles) const {
  const double* cost = costs_.data();
  std::array<std::array<double, kMaxRing>, kMaxRing> best;
  std::array<std::array<uint8_t, kMaxRing>, kMaxRing> apex;
  for (uint32_t i = 0; i + 1 < k; ++i) best[i][i + 1] = 0;
  for (uint32_t span = 2; span < k; ++span) {
    for (uint32_t i = 0; i + span < k; ++i) {
      const uint32_t j = i + span;
      best[i][j] = kInfinity;
      apex[i][j] = 0;
      const double* costs = cost;
      cost += span - 1;
      const bool closing = span == k - 1;  // the ring's own edge, or the new border edge
      if (!closing && (forbidden[i][j] || edge_error[i][j] < 0)) continue;
      for (uint32_t m = i + 1; m < j; ++m) {
        const double total = best[i][m] + best[m][j] + *costs++;
        if (total < best[i][j]) {
          best[i][j] = total;
          apex[i][j] = static_cast<uint8_t>(m);
        }
      }
      const double e = edge_error[i][j];
      if (!closing || boundary) best[i][j] += e * e;
    }
  }
  if (!(best[0][k - 1] < kInfinity)) return false;
  uint32_t count = 0;
  std::array<std::pair<uint8_t, uint8_t>, 2 * kMaxRing> stack;
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

}  // namespace mtdb
