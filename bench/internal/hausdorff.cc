// SPDX-License-Identifier: Apache-2.0
#include "bench/internal/hausdorff.h"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>
#include <algorithm>
#include <cmath>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "store/base/hilbert.h"

namespace mtdb {

namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Triangle = Kernel::Triangle_3;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, std::vector<Triangle>::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

// Neighbours in space become neighbours in the list.
void SortAlongCurve(std::vector<Vec3d>& points) {
  Box3d bounds;
  for (const Vec3d& p : points) bounds.Add(p);
  const Vec3d size = bounds.max - bounds.min;
  const double longest = std::max({size.x, size.y, size.z});
  const double scale = longest > 0 ? ((1u << kHilbertBits) - 1) / longest : 0;
  std::vector<std::pair<uint64_t, uint32_t>> order(points.size());
  for (uint32_t i = 0; i < points.size(); ++i) {
    const Vec3d cell = (points[i] - bounds.min) * scale;
    order[i] = {HilbertCode({static_cast<uint32_t>(cell.x), static_cast<uint32_t>(cell.y),
                             static_cast<uint32_t>(cell.z)}),
                i};
  }
  std::sort(order.begin(), order.end());
  std::vector<Vec3d> sorted;
  sorted.reserve(points.size());
  for (const auto& [code, i] : order) sorted.push_back(points[i]);
  points = std::move(sorted);
}

std::vector<Vec3d> Samples(const TriangleMesh& mesh, uint64_t count, uint64_t seed) {
  std::vector<Vec3d> points;
  std::vector<double> area_sum;
  double total = 0;
  for (const TriangleVertices& t : mesh.triangles) {
    const Vec3d a = mesh.positions[t[0]];
    total += 0.5 * Length(Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a));
    area_sum.push_back(total);
    for (const VertexIndex v : t) points.push_back(mesh.positions[v]);
  }
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (uint64_t i = 0; i < count; ++i) {
    const auto at = std::lower_bound(area_sum.begin(), area_sum.end(), uniform(random) * total);
    const size_t f =
        std::min<size_t>(static_cast<size_t>(at - area_sum.begin()), area_sum.size() - 1);
    const TriangleVertices& t = mesh.triangles[f];
    const double r = std::sqrt(uniform(random));
    const double s = uniform(random);
    points.push_back(mesh.positions[t[0]] * (1 - r) + mesh.positions[t[1]] * (r * (1 - s)) +
                     mesh.positions[t[2]] * (r * s));
  }
  SortAlongCurve(points);
  return points;
}

}  // namespace

struct HausdorffMeter::Side {
  Side(const TriangleMesh& mesh, uint64_t samples, uint64_t seed)
      : points(Samples(mesh, samples, seed)) {
    triangles.reserve(mesh.triangles.size());
    const auto point = [&](VertexIndex v) {
      const Vec3d& p = mesh.positions[v];
      return Kernel::Point_3(p.x, p.y, p.z);
    };
    for (const TriangleVertices& t : mesh.triangles) {
      triangles.emplace_back(point(t[0]), point(t[1]), point(t[2]));
    }
    tree.insert(triangles.begin(), triangles.end());
    tree.build();
  }
  // Of these points.
  double LargestDistance(const std::vector<Vec3d>& from) const {
    const unsigned threads = std::max(1u, std::thread::hardware_concurrency());
    std::vector<double> largest(threads, 0);
    {
      std::vector<std::jthread> workers;
      for (unsigned w = 0; w < threads; ++w) {
        workers.emplace_back([&, w] {
          const size_t begin = from.size() * w / threads;
          const size_t end = from.size() * (w + 1) / threads;
          Tree::Point_and_primitive_id nearest = tree.any_reference_point_and_id();
          for (size_t i = begin; i < end; ++i) {
            const Kernel::Point_3 p(from[i].x, from[i].y, from[i].z);
            // Most points are as near to a triangle that was nearest to a neighbour as the largest
            // distance so far: they cannot raise it.
            if (CGAL::squared_distance(p, *nearest.second) <= largest[w]) continue;
            nearest = tree.closest_point_and_primitive(p, nearest);
            largest[w] = std::max(largest[w], CGAL::squared_distance(p, nearest.first));
          }
        });
      }
    }
    return std::sqrt(*std::max_element(largest.begin(), largest.end()));
  }

  std::vector<double> SquaredDistances(const std::vector<Vec3d>& from) const {
    const unsigned threads = std::max(1u, std::thread::hardware_concurrency());
    std::vector<double> distances(from.size());
    std::vector<std::jthread> workers;
    for (unsigned w = 0; w < threads; ++w) {
      workers.emplace_back([&, w] {
        Tree::Point_and_primitive_id nearest = tree.any_reference_point_and_id();
        for (size_t i = from.size() * w / threads; i < from.size() * (w + 1) / threads; ++i) {
          const Kernel::Point_3 p(from[i].x, from[i].y, from[i].z);
          nearest = tree.closest_point_and_primitive(p, nearest);
          distances[i] = CGAL::squared_distance(p, nearest.first);
        }
      });
    }
    workers.clear();
    return distances;
  }

  std::vector<Vec3d> points;
  std::vector<Triangle> triangles;
  Tree tree;
};

HausdorffMeter::HausdorffMeter(const TriangleMesh& mesh, uint64_t samples, uint64_t seed)
    : side_(std::make_unique<Side>(mesh, samples, seed)), samples_(samples), seed_(seed) {}
HausdorffMeter::~HausdorffMeter() = default;

double HausdorffMeter::Distance(const TriangleMesh& other) const {
  const Side theirs(other, samples_, seed_);
  return std::max(theirs.LargestDistance(side_->points), side_->LargestDistance(theirs.points));
}

double OneSidedHausdorff(const TriangleMesh& from, const TriangleMesh& to, uint64_t samples,
                         uint64_t seed) {
  const HausdorffMeter::Side surface(to, 0, seed);
  return surface.LargestDistance(Samples(from, samples, seed));
}

double SymmetricHausdorff(const TriangleMesh& a, const TriangleMesh& b, uint64_t samples,
                          uint64_t seed) {
  return HausdorffMeter(a, samples, seed).Distance(b);
}

double LargestVertexDistance(const TriangleMesh& from, const TriangleMesh& to) {
  const HausdorffMeter::Side surface({{}, to.positions, to.triangles, {}, {}}, 0, 1);
  std::vector<Vec3d> points = from.positions;
  SortAlongCurve(points);
  const std::vector<double> distances = surface.SquaredDistances(points);
  return std::sqrt(*std::ranges::max_element(distances));
}

}  // namespace mtdb
