#include "bench/internal/hausdorff.h"

#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>
#include <algorithm>
#include <cmath>
#include <random>
#include <thread>
#include <vector>

namespace mtdb {

namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Triangle = Kernel::Triangle_3;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, std::vector<Triangle>::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

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
  return points;
}

}  // namespace

double OneSidedHausdorff(const TriangleMesh& from, const TriangleMesh& to, uint64_t samples,
                         uint64_t seed) {
  std::vector<Triangle> triangles;
  triangles.reserve(to.triangles.size());
  const auto point = [&](VertexIndex v) {
    const Vec3d& p = to.positions[v];
    return Kernel::Point_3(p.x, p.y, p.z);
  };
  for (const TriangleVertices& t : to.triangles) {
    triangles.emplace_back(point(t[0]), point(t[1]), point(t[2]));
  }
  Tree tree(triangles.begin(), triangles.end());
  tree.build();
  tree.accelerate_distance_queries();
  const std::vector<Vec3d> points = Samples(from, samples, seed);
  const unsigned threads = std::max(1u, std::thread::hardware_concurrency());
  std::vector<double> largest(threads, 0);
  {
    std::vector<std::jthread> workers;
    for (unsigned w = 0; w < threads; ++w) {
      workers.emplace_back([&, w] {
        const size_t begin = points.size() * w / threads;
        const size_t end = points.size() * (w + 1) / threads;
        for (size_t i = begin; i < end; ++i) {
          const Kernel::Point_3 p(points[i].x, points[i].y, points[i].z);
          largest[w] = std::max(largest[w], tree.squared_distance(p));
        }
      });
    }
  }
  return std::sqrt(*std::max_element(largest.begin(), largest.end()));
}

double SymmetricHausdorff(const TriangleMesh& a, const TriangleMesh& b, uint64_t samples,
                          uint64_t seed) {
  return std::max(OneSidedHausdorff(a, b, samples, seed), OneSidedHausdorff(b, a, samples, seed));
}

}  // namespace mtdb
