// SPDX-License-Identifier: Apache-2.0
#include "tests/everything/polygons.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "store/base/hash.h"

namespace mtdb::everything {

namespace {

// The corners of two triangles that share an edge in opposite directions, from one that both have
// to the other one and back.
std::optional<std::array<VertexIndex, 4>> QuadOf(const TriangleVertices& s,
                                                 const TriangleVertices& t) {
  for (size_t i = 0; i < 3; ++i) {
    for (size_t k = 0; k < 3; ++k) {
      if (s[i] != t[(k + 1) % 3] || s[(i + 1) % 3] != t[k]) continue;
      const std::array<VertexIndex, 4> quad{s[i], t[(k + 2) % 3], s[(i + 1) % 3], s[(i + 2) % 3]};
      for (size_t a = 0; a < 4; ++a) {
        for (size_t b = a + 1; b < 4; ++b) {
          if (quad[a] == quad[b]) return std::nullopt;
        }
      }
      return quad;
    }
  }
  return std::nullopt;
}

// Twice the area of the triangle as it is seen along the axis, and what it may be off by rounding.
struct Seen {
  double area = 0, doubt = 0;
};
Seen AreaAlong(int axis, Vec3d a, Vec3d b, Vec3d c) {
  const int x = (axis + 1) % 3, y = (axis + 2) % 3;
  const double left = (b[x] - a[x]) * (c[y] - a[y]), right = (b[y] - a[y]) * (c[x] - a[x]);
  return {left - right, 1e-9 * (std::abs(left) + std::abs(right))};
}

// Whether 0-2 is the one diagonal that can be meant, by a wide margin.
bool HasOneDiagonal(const std::array<Vec3d, 4>& p) {
  const Vec3d normal = Cross(p[2] - p[0], p[3] - p[1]);  // twice the area, whatever the diagonal
  int axis = 0;
  for (int i = 1; i < 3; ++i) {
    if (std::abs(normal[i]) > std::abs(normal[axis])) axis = i;
  }
  // Where two axes show nearly as much, either may be looked along.
  for (int i = 0; i < 3; ++i) {
    if (i != axis && std::abs(normal[i]) > 0.999 * std::abs(normal[axis])) return false;
  }
  const double side = normal[axis] < 0 ? -1 : 1;
  const auto sign = [&](int a, int b, int c) {
    const Seen seen = AreaAlong(axis, p[a], p[b], p[c]);
    return std::abs(seen.area) <= seen.doubt ? 0 : seen.area * side > 0 ? 1 : -1;
  };
  if (sign(0, 1, 2) != 1 || sign(0, 2, 3) != 1) return false;
  const int first = sign(0, 1, 3), second = sign(1, 2, 3);
  if (first < 0 || second < 0) return true;
  return first > 0 && second > 0 && SquaredLength(p[2] - p[0]) < 0.9 * SquaredLength(p[3] - p[1]);
}

}  // namespace

Faces TriangleFaces(const TriangleMesh& mesh) {
  Faces faces;
  for (const TriangleVertices& t : mesh.triangles) faces.push_back({t[0], t[1], t[2]});
  return faces;
}

void AddDarts(uint64_t seed, TriangleMesh* mesh) {
  std::vector<TriangleVertices> triangles;
  for (const TriangleVertices& t : mesh->triangles) {
    const auto& [a, b, c] = t;
    if (a == b || b == c || c == a || Mix64(seed + triangles.size()) % 3 != 0) {
      triangles.push_back(t);
      continue;
    }
    const auto& p = mesh->positions;
    const VertexIndex inner = p.size();
    mesh->positions.push_back(0.375 * p[a] + 0.375 * p[b] + 0.25 * p[c]);
    triangles.insert(triangles.end(), {{b, c, inner}, {c, a, inner}, {a, b, inner}});
  }
  mesh->triangles = std::move(triangles);
}

Faces JoinedFaces(const TriangleMesh& mesh) {
  Faces faces;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const TriangleVertices& t = mesh.triangles[i];
    if (i + 1 < mesh.triangles.size()) {
      const auto quad = QuadOf(t, mesh.triangles[i + 1]);
      std::array<Vec3d, 4> p;
      for (size_t c = 0; quad && c < 4; ++c) p[c] = mesh.positions[(*quad)[c]];
      if (quad && HasOneDiagonal(p)) {
        // Any corner may come first.
        std::vector<VertexIndex> face(quad->begin(), quad->end());
        std::rotate(face.begin(), face.begin() + static_cast<std::ptrdiff_t>(i % 4), face.end());
        faces.push_back(std::move(face));
        ++i;
        continue;
      }
    }
    faces.push_back({t[0], t[1], t[2]});
  }
  return faces;
}

}  // namespace mtdb::everything
