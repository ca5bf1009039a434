// SPDX-License-Identifier: Apache-2.0
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>
#include <algorithm>
#include <cmath>
#include <set>

#include "tests/sheets/cut_check.h"

namespace mtdb::sheets {
namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Corners = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Corners::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

constexpr double kMostSteps = 200;  // of a triangle

Corners CornersOf(const Complex& complex) {
  const auto point = [&](uint32_t v) {
    const Point& p = complex.points[v];
    return Kernel::Point_3(p[0], p[1], p[2]);
  };
  Corners corners;
  for (const Triangle& t : complex.triangles) {
    corners.emplace_back(point(t[0]), point(t[1]), point(t[2]));
  }
  return corners;
}

}  // namespace

double LargestDistance(const Complex& from, const Complex& to, double step) {
  const Corners corners = CornersOf(to);
  Tree tree(corners.begin(), corners.end());
  tree.build();
  // A triangle and its opposite have the same points.
  std::set<Triangle> seen;
  double largest = 0;
  const Corners all = CornersOf(from);
  for (size_t i = 0; i < all.size(); ++i) {
    Triangle key = from.triangles[i];
    std::sort(key.begin(), key.end());
    if (!seen.insert(key).second) continue;
    const Kernel::Triangle_3& t = all[i];
    const double longest =
        std::sqrt(std::max({CGAL::squared_distance(t[0], t[1]), CGAL::squared_distance(t[1], t[2]),
                            CGAL::squared_distance(t[2], t[0])}));
    const auto steps = static_cast<int>(std::clamp(std::ceil(longest / step), 1.0, kMostSteps));
    for (int u = 0; u <= steps; ++u) {
      for (int v = 0; u + v <= steps; ++v) {
        const Kernel::Point_3 p = t[0] + (t[1] - t[0]) * (static_cast<double>(u) / steps) +
                                  (t[2] - t[0]) * (static_cast<double>(v) / steps);
        largest = std::max(largest, tree.squared_distance(p));
      }
    }
  }
  return std::sqrt(largest);
}

}  // namespace mtdb::sheets
