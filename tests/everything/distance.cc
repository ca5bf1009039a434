// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/distance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace mtdb::everything {

namespace {

constexpr uint32_t kLeaf = 4;

Vec3d Middle(const Triangle3d& t) { return (t[0] + t[1] + t[2]) * (1.0 / 3); }

// In long double, since double is not exact enough for what is compared here: the distance of a
// point of a needle to that needle may come out as 1e-9 of its length.
struct Long {
  long double x, y, z;
};
Long Between(Vec3d from, Vec3d to) {
  return {static_cast<long double>(to.x) - from.x, static_cast<long double>(to.y) - from.y,
          static_cast<long double>(to.z) - from.z};
}
long double DotOf(Long a, Long b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Long CrossOf(Long a, Long b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

long double SquaredToSegment(Vec3d p, Vec3d a, Vec3d b) {
  const Long ab = Between(a, b);
  const Long ap = Between(a, p);
  const long double length2 = DotOf(ab, ab);
  const long double t = length2 > 0
                            ? std::clamp(DotOf(ap, ab) / length2, static_cast<long double>(0),
                                         static_cast<long double>(1))
                            : 0;
  const Long off{ap.x - t * ab.x, ap.y - t * ab.y, ap.z - t * ab.z};
  return DotOf(off, off);
}

// Above the triangle its plane is nearest, else one of its edges.
double SquaredToTriangle(Vec3d p, const Triangle3d& t) {
  const Long normal = CrossOf(Between(t[0], t[1]), Between(t[0], t[2]));
  const long double size2 = DotOf(normal, normal);
  bool above = size2 > 0;
  for (size_t e = 0; e < 3 && above; ++e) {
    above = DotOf(CrossOf(Between(t[e], t[(e + 1) % 3]), Between(t[e], p)), normal) >= 0;
  }
  if (above) {
    const long double height = DotOf(Between(t[0], p), normal);
    return static_cast<double>(height * height / size2);
  }
  return static_cast<double>(
      std::min({SquaredToSegment(p, t[0], t[1]), SquaredToSegment(p, t[1], t[2]),
                SquaredToSegment(p, t[2], t[0])}));
}

}  // namespace

DistanceTree::DistanceTree(const TriangleMesh& mesh) {
  for (const TriangleVertices& t : mesh.triangles) {
    triangles_.push_back({mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]});
  }
  nodes_.push_back({.box = {}, .end = static_cast<uint32_t>(triangles_.size())});
  if (!triangles_.empty()) Split(0, 0);
}

void DistanceTree::Split(uint32_t node, int depth) {
  const uint32_t begin = nodes_[node].begin;
  const uint32_t end = nodes_[node].end;
  Box3d box, middles;
  for (uint32_t i = begin; i < end; ++i) {
    for (const Vec3d& p : triangles_[i]) box.Add(p);
    middles.Add(Middle(triangles_[i]));
  }
  nodes_[node].box = box;
  if (end - begin <= kLeaf || depth > 40) return;
  const Vec3d size = middles.max - middles.min;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const uint32_t half = begin + (end - begin) / 2;
  std::nth_element(
      triangles_.begin() + begin, triangles_.begin() + half, triangles_.begin() + end,
      [&](const Triangle3d& a, const Triangle3d& b) { return Middle(a)[axis] < Middle(b)[axis]; });
  const auto child = static_cast<uint32_t>(nodes_.size());
  nodes_[node].child = child;
  nodes_.push_back({.box = {}, .begin = begin, .end = half});
  nodes_.push_back({.box = {}, .begin = half, .end = end});
  Split(child, depth + 1);
  Split(child + 1, depth + 1);
}

double DistanceTree::Distance(Vec3d p) const {
  double best = std::numeric_limits<double>::infinity();
  if (triangles_.empty()) return best;
  std::vector<uint32_t> stack{0};
  while (!stack.empty()) {
    const Node& node = nodes_[stack.back()];
    stack.pop_back();
    if (SquaredDistancePointBox(p, node.box) >= best) continue;
    if (node.child == 0) {
      for (uint32_t i = node.begin; i < node.end; ++i) {
        const Triangle3d& t = triangles_[i];
        // Of most triangles double is enough to tell that they are farther.
        const double about = SquaredDistancePointTriangle(p, t[0], t[1], t[2]);
        const double noise = 1e-16 * (SquaredLength(t[1] - t[0]) + SquaredLength(t[2] - t[0]));
        if (about > 2 * best + noise) continue;
        best = std::min(best, SquaredToTriangle(p, t));
      }
      continue;
    }
    const bool second = SquaredDistancePointBox(p, nodes_[node.child].box) <
                        SquaredDistancePointBox(p, nodes_[node.child + 1].box);
    stack.push_back(second ? node.child + 1 : node.child);
    stack.push_back(second ? node.child : node.child + 1);
  }
  return std::sqrt(best);
}

std::vector<Vec3d> SamplePoints(const TriangleMesh& mesh, uint64_t count, uint64_t seed) {
  std::vector<Vec3d> points;
  std::vector<double> sums;
  double total = 0;
  std::vector<bool> taken(mesh.positions.size(), false);
  for (const TriangleVertices& t : mesh.triangles) {
    const Vec3d a = mesh.positions[t[0]];
    total += Length(Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a));
    sums.push_back(total);
    for (const VertexIndex v : t) {
      if (!taken[v]) points.push_back(mesh.positions[v]);
      taken[v] = true;
    }
  }
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (uint64_t i = 0; i < count && total > 0 && std::isfinite(total); ++i) {
    const auto at = std::lower_bound(sums.begin(), sums.end(), uniform(random) * total);
    const auto f = std::min(static_cast<size_t>(at - sums.begin()), sums.size() - 1);
    const TriangleVertices& t = mesh.triangles[f];
    const double r = std::sqrt(uniform(random));
    const double s = uniform(random);
    points.push_back(mesh.positions[t[0]] * (1 - r) + mesh.positions[t[1]] * (r * (1 - s)) +
                     mesh.positions[t[2]] * (r * s));
  }
  return points;
}

}  // namespace mtdb::everything
