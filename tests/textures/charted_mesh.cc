// SPDX-License-Identifier: Apache-2.0
#include "tests/textures/charted_mesh.h"

#include <array>
#include <cmath>
#include <random>

namespace mtdb::testing {
namespace {

constexpr double kTurn = 6.283185307179586;

struct Place {
  double s, t;  // 0..1 around the torus, or across the sheet
};

Vec3d OnTorus(Place p, double waves) {
  const double small = 0.4 + 0.03 * std::sin(waves * kTurn * p.s) * std::cos(5 * kTurn * p.t);
  const double radius = 1 + small * std::cos(kTurn * p.t);
  return {radius * std::cos(kTurn * p.s), radius * std::sin(kTurn * p.s),
          small * std::sin(kTurn * p.t)};
}

// Bends the image along u.
double Stretched(double u, double stretch) { return u + stretch * 0.1 * std::sin(kTurn * u); }

struct Maker {
  Charting charting;
  uint32_t columns, rows;
  double stretch;
  TriangleMesh mesh;

  Place At(uint32_t i, uint32_t j) const {
    return {static_cast<double>(i) / columns, static_cast<double>(j) / rows};
  }
  // Where a corner of the square (x, y) lies in the image; `i`, `j`: of the grid, not wrapped.
  TextureCorner Corner(uint32_t triangle, uint32_t x, uint32_t y, uint32_t i, uint32_t j,
                       Vec3d normal) const {
    const Place p = At(i, j);
    if (charting == Charting::kTriangles) {
      const double u = (triangle % 64 + (i == x ? 0.1 : 0.9)) / 64;
      const double v = (triangle / 64 % 64 + (j == y ? 0.1 : 0.9)) / 64;
      return {static_cast<float>(u), static_cast<float>(v), triangle % 2};
    }
    if (charting == Charting::kPatches) {
      const uint32_t a = x * 4 / columns, b = y * 3 / rows;
      const double u = Stretched(p.s * 4 - a, stretch) * 0.2 + a * 0.24;
      const double v = Stretched(p.t * 3 - b, stretch) * 0.3 + b * 0.33;
      return {static_cast<float>(u), static_cast<float>(v), (a + b) % 2};
    }
    if (charting == Charting::kSlit) {
      // Below the line from the border to the middle the image is pushed aside, less and less.
      const double depth = std::max(0.0, 0.5 - p.s);
      const bool below = y < rows / 2;
      return {static_cast<float>(Stretched(p.s, stretch) * 0.8),
              static_cast<float>(0.5 + (p.t - 0.5) * 0.5 + (below ? -0.2 : 0.2) * depth), 0};
    }
    const Vec3d q = OnTorus(p, 3);
    int axis = 0;
    for (int k = 1; k < 3; ++k) {
      if (std::abs(normal[k]) > std::abs(normal[axis])) axis = k;
    }
    const auto chart = static_cast<uint32_t>(2 * axis + (normal[axis] > 0 ? 1 : 0));
    const double a = q[(axis + 1) % 3], b = q[(axis + 2) % 3];
    return {static_cast<float>(0.05 + (a + 1.5) * 0.1 + 0.33 * (chart % 3)),
            static_cast<float>(0.05 + Stretched((b + 1.5) / 3, stretch) * 0.3), chart / 3};
  }
};

}  // namespace

const char* NameOf(Charting charting) {
  constexpr std::array kNames{"views", "patches", "slit", "triangles"};
  return kNames[static_cast<uint32_t>(charting)];
}

TriangleMesh MakeCharted(Charting charting, uint32_t columns, uint32_t rows, double stretch,
                         uint32_t seed) {
  Maker maker{charting, columns, rows, stretch, {}};
  TriangleMesh& mesh = maker.mesh;
  mesh.header.textured = true;
  mesh.header.textures = {{"a.png", "image/png", 1024, 1024, {}},
                          {"b.png", "image/png", 1024, 1024, {}}};
  const bool sheet = charting == Charting::kSlit;
  const uint32_t across = sheet ? columns + 1 : columns;
  const uint32_t up = sheet ? rows + 1 : rows;
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-1e-3, 1e-3);
  for (uint32_t j = 0; j < up; ++j) {
    for (uint32_t i = 0; i < across; ++i) {
      const Place p = maker.At(i, j);
      const Vec3d at = sheet ? Vec3d{2 * p.s, 2 * p.t, 0.1 * std::sin(9 * p.s) * std::cos(7 * p.t)}
                             : OnTorus(p, 3);
      const Vec3d q = at + Vec3d{noise(random), noise(random), noise(random)};
      mesh.positions.push_back(
          {static_cast<float>(q.x), static_cast<float>(q.y), static_cast<float>(q.z)});
    }
  }
  const auto vertex = [&](uint32_t i, uint32_t j) {
    return VertexIndex{(j % up) * across + i % across};
  };
  for (uint32_t y = 0; y < rows; ++y) {
    for (uint32_t x = 0; x < columns; ++x) {
      const std::array<std::array<uint32_t, 2>, 4> c{
          {{x, y}, {x + 1, y}, {x + 1, y + 1}, {x, y + 1}}};
      for (const std::array<uint32_t, 3>& t : {std::array{0u, 1u, 2u}, std::array{0u, 2u, 3u}}) {
        const auto number = static_cast<uint32_t>(mesh.triangles.size());
        TriangleVertices& triangle = mesh.triangles.emplace_back();
        for (size_t k = 0; k < 3; ++k) triangle[k] = vertex(c[t[k]][0], c[t[k]][1]);
        const Vec3d a = mesh.positions[triangle[0]];
        const Vec3d normal =
            Cross(mesh.positions[triangle[1]] - a, mesh.positions[triangle[2]] - a);
        for (const uint32_t k : t) {
          mesh.corners.push_back(maker.Corner(number, x, y, c[k][0], c[k][1], normal));
        }
      }
    }
  }
  return mesh;
}

}  // namespace mtdb::testing
