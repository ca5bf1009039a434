// SPDX-License-Identifier: Apache-2.0
#include "tests/query/compare/compare_meshes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mtdb::testing {

TriangleMesh Sphere(int side, double radius) {
  TriangleMesh mesh;
  mesh.positions.push_back({0, 0, radius});
  for (int i = 1; i < side; ++i) {
    const double theta = std::numbers::pi * i / side;
    for (int j = 0; j < side; ++j) {
      const double phi = 2 * std::numbers::pi * j / side;
      mesh.positions.push_back({radius * std::sin(theta) * std::cos(phi),
                                radius * std::sin(theta) * std::sin(phi),
                                radius * std::cos(theta)});
    }
  }
  mesh.positions.push_back({0, 0, -radius});
  const auto at = [&](int i, int j) -> VertexIndex {
    if (i == 0) return 0;
    if (i == side) return mesh.positions.size() - 1;
    return static_cast<VertexIndex>(1 + (i - 1) * side + j % side);
  };
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      if (i > 0) mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
      if (i + 1 < side) mesh.triangles.push_back({at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

TriangleMesh Plane(int side, const std::vector<Vec3d>& dents, double depth) {
  constexpr double kRadius = 0.05;
  TriangleMesh mesh;
  for (int y = 0; y <= side; ++y) {
    for (int x = 0; x <= side; ++x) {
      Vec3d p{static_cast<double>(x) / side, static_cast<double>(y) / side, 0};
      for (const Vec3d& dent : dents) {
        const double r = std::hypot(p.x - dent.x, p.y - dent.y) / kRadius;
        if (r < 1) p.z -= depth * (1 - r * r);
      }
      mesh.positions.push_back(p);
    }
  }
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const auto a = static_cast<VertexIndex>(y * (side + 1) + x);
      const VertexIndex b = a + static_cast<VertexIndex>(side) + 1;
      mesh.triangles.push_back({a, a + 1, b + 1});
      mesh.triangles.push_back({a, b + 1, b});
    }
  }
  return mesh;
}

TriangleMesh Moved(TriangleMesh mesh, Vec3d by) {
  for (Vec3d& p : mesh.positions) p += by;
  return mesh;
}

TriangleMesh Shaken(TriangleMesh mesh, double by) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> within(-by, by);
  for (Vec3d& p : mesh.positions) p += Vec3d{within(random), within(random), within(random)};
  return mesh;
}

TriangleMesh Clipped(TriangleMesh mesh, double x) {
  std::erase_if(mesh.triangles, [&](const TriangleVertices& t) {
    return std::ranges::any_of(t, [&](VertexIndex v) { return mesh.positions[v].x > x; });
  });
  return mesh;
}

TriangleMesh Soup(int triangles, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto point = [&](double size) {
    return Vec3d{size * unit(random), size * unit(random), size * unit(random)};
  };
  TriangleMesh mesh;
  for (int i = 0; i < triangles; ++i) {
    const Vec3d a = point(1);
    const double size = std::pow(10, unit(random));
    const Vec3d b = a + point(size);
    // A third of them are needles.
    const Vec3d c = i % 3 == 2 ? a + (b - a) * (0.5 + unit(random)) + point(1e-6) : a + point(size);
    const VertexIndex first = mesh.positions.size();
    mesh.positions.insert(mesh.positions.end(), {a, b, c});
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

}  // namespace mtdb::testing
