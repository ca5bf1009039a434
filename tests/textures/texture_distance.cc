// SPDX-License-Identifier: Apache-2.0
#include "tests/textures/texture_distance.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mtdb::testing {
namespace {

// Position, and u, v scaled.
using Point = std::array<double, 5>;
using Triangle = std::array<Point, 3>;

Triangle TriangleOf(const TriangleMesh& mesh, size_t t, double scale) {
  Triangle points;
  for (size_t c = 0; c < 3; ++c) {
    const Vec3d p = mesh.positions[mesh.triangles[t][c]];
    const TextureCorner& corner = mesh.corners[3 * t + c];
    points[c] = {p.x, p.y, p.z, scale * corner.u, scale * corner.v};
  }
  return points;
}

Point Mix(const Triangle& t, double v, double w) {
  Point p;
  for (size_t k = 0; k < 5; ++k) p[k] = t[0][k] * (1 - v - w) + t[1][k] * v + t[2][k] * w;
  return p;
}

double Apart(const Point& p, const Point& q) {
  const auto squared = [&](size_t begin, size_t end) {
    double sum = 0;
    for (size_t k = begin; k < end; ++k) sum += (p[k] - q[k]) * (p[k] - q[k]);
    return sum;
  };
  return std::sqrt(std::max(squared(0, 3), squared(3, 5)));
}

// The least of a convex function on 0..most, by thirds.
template <typename F>
double Least(double most, F&& f) {
  double low = 0, high = most;
  double best = std::min(f(low), f(high));
  for (int step = 0; step < 24; ++step) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    const double at_a = f(a), at_b = f(b);
    best = std::min({best, at_a, at_b});
    (at_a < at_b ? high : low) = at_a < at_b ? b : a;
  }
  return best;
}

double FromTriangle(const Point& p, const Triangle& t) {
  return Least(
      1, [&](double v) { return Least(1 - v, [&](double w) { return Apart(p, Mix(t, v, w)); }); });
}

// No point of the triangle is nearer than this.
double FromBox(const Point& p, const Triangle& t) {
  double most = 0;
  for (size_t k = 0; k < 5; ++k) {
    const auto [low, high] = std::minmax({t[0][k], t[1][k], t[2][k]});
    most = std::max({most, low - p[k], p[k] - high});
  }
  return most;
}

}  // namespace

double LargestTextureDistance(const TriangleMesh& from, const TriangleMesh& to, double scale,
                              double far, size_t samples, std::mt19937& random) {
  std::vector<Triangle> triangles;
  for (size_t t = 0; t < to.triangles.size(); ++t) triangles.push_back(TriangleOf(to, t, scale));
  std::uniform_real_distribution<double> unit(0, 1);
  double largest = 0;
  for (size_t s = 0; s < samples; ++s) {
    const size_t own = random() % from.triangles.size();
    double v = unit(random), w = unit(random);
    if (v + w > 1) {
      v = 1 - v;
      w = 1 - w;
    }
    // Corners and edges, too.
    if (s % 4 == 1) v = 0;
    if (s % 4 == 2) v = w = 0;
    const Point p = Mix(TriangleOf(from, own, scale), v, w);
    double least = far;
    for (size_t t = 0; t < triangles.size(); ++t) {
      if (to.corners[3 * t].page != from.corners[3 * own].page) continue;
      if (FromBox(p, triangles[t]) >= least) continue;
      least = std::min(least, FromTriangle(p, triangles[t]));
      if (least <= largest) break;  // it will not be the largest
    }
    largest = std::max(largest, least);
  }
  return largest;
}

}  // namespace mtdb::testing
