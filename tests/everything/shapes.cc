// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <random>

#include "store/base/hash.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/everything/input.h"
#include "tools/generate/generate.h"

namespace mtdb::everything {

namespace {

constexpr double kPi = 3.14159265358979;

// m x n cells around a ring; `closed` across it too, else an open band.
TriangleMesh Ring(int m, int n, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> bump(-0.05, 0.05);
  TriangleMesh mesh;
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < m; ++i) {
      const double u = 2 * kPi * i / m, v = 2 * kPi * j / n;
      const double thick = 0.4 + bump(random);
      const double r = 1 + thick * std::cos(v);
      mesh.positions.push_back({r * std::cos(u), r * std::sin(u), thick * std::sin(v)});
    }
  }
  const auto vertex = [&](int i, int j) { return static_cast<VertexIndex>((j % n) * m + i % m); };
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < m; ++i) {
      const VertexIndex a = vertex(i, j), b = vertex(i + 1, j);
      const VertexIndex c = vertex(i + 1, j + 1), d = vertex(i, j + 1);
      mesh.triangles.push_back({a, b, c});
      mesh.triangles.push_back({a, c, d});
    }
  }
  return mesh;
}

TriangleMesh MakeTorus(int64_t size, uint64_t seed) {
  const int n = std::max(3, static_cast<int>(std::sqrt(static_cast<double>(size) / 4)));
  return Ring(2 * n, n, seed);
}

TriangleMesh MakeSheetOf(int64_t size, uint64_t seed) {
  const int n = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(size) / 2)));
  return mtdb::testing::MakeSheet(n, 0.05, static_cast<uint32_t>(seed));
}

// The smooth kind, which simplifies far.
TriangleMesh MakeWave(int64_t size, uint64_t seed) {
  TriangleMesh mesh = MakeSheetOf(size, seed);
  const double phase = static_cast<double>(seed % 100);
  for (Vec3d& p : mesh.positions) {
    p.z = 0.1 * std::sin(5 * p.x + phase) * std::cos(4 * p.y) + 0.02 * p.z;
  }
  return mesh;
}

TriangleMesh MakeTetrahedra(int64_t size, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> at(0, 1);
  TriangleMesh mesh;
  for (int64_t i = 0; i < std::max<int64_t>(1, size / 4); ++i) {
    const Vec3d p{at(random), at(random), at(random)};
    const VertexIndex a = mesh.positions.size();
    const double s = 0.1 * at(random) + 0.01;
    mesh.positions.insert(mesh.positions.end(),
                          {p, p + Vec3d{s, 0, 0}, p + Vec3d{0, s, 0}, p + Vec3d{0, 0, s}});
    for (const TriangleVertices& t : {TriangleVertices{0, 2, 1}, TriangleVertices{0, 1, 3},
                                      TriangleVertices{0, 3, 2}, TriangleVertices{1, 2, 3}}) {
      mesh.triangles.push_back({a + t[0], a + t[1], a + t[2]});
    }
  }
  return mesh;
}

// Triangles at random among a few vertices: as non-manifold as it gets.
TriangleMesh MakeTangle(int64_t size, uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> at(0, 1);
  TriangleMesh mesh;
  const auto vertices = static_cast<VertexIndex>(3 + size / 3);
  for (VertexIndex v = 0; v < vertices; ++v) {
    mesh.positions.push_back({at(random), at(random), at(random)});
  }
  for (int64_t i = 0; i < size; ++i) {
    mesh.triangles.push_back({random() % vertices, random() % vertices, random() % vertices});
  }
  mesh.triangles.push_back({0, 1, 2});  // one at least is none that is dropped
  return mesh;
}

// A sheet whose points lie on a few lines, in any order: needles, triangles without area, folds.
// Half of it is a fan, all of whose triangles meet in one vertex.
TriangleMesh MakeNeedles(int64_t size, uint64_t seed) {
  std::mt19937_64 random(seed);
  TriangleMesh mesh = MakeSheetOf(size / 2, seed);
  const double width = 0.1 * static_cast<double>(1 + seed % 4);
  for (Vec3d& p : mesh.positions) {
    p.x = width * std::floor(p.x / width);
    if (random() % 2 == 0) p.y = 0.05 * static_cast<double>(random() % 20);
    p.z = 0;
  }
  const VertexIndex hub = mesh.positions.size();
  const VertexIndex count = 3 + static_cast<VertexIndex>(size / 2);
  mesh.positions.push_back({3, 0, 0.5});
  for (VertexIndex i = 0; i < count; ++i) {
    const double angle = 2 * kPi * static_cast<double>(i) / static_cast<double>(count);
    const double radius = 1 + 0.01 * static_cast<double>(random() % 10);
    mesh.positions.push_back({3 + radius * std::cos(angle), radius * std::sin(angle), 0});
    mesh.triangles.push_back({hub, hub + 1 + i, hub + 1 + (i + 1) % count});
  }
  return mesh;
}

// A tube of long, thin quads: a cylinder, a sphere of meridians, or one whose ends are fans around
// vertices of high valence; the seed says which, and how it is turned.
TriangleMesh MakeMeridians(int64_t size, uint64_t seed) {
  const uint64_t rings = 2 + seed % 6;
  const bool closed = seed / 6 % 2 == 1;
  const auto count = std::max<VertexIndex>(
      3, static_cast<VertexIndex>(size) / (2 * (rings - 1) + (closed ? 2 : 0)));
  const double tilt = 0.1 * static_cast<double>(seed % 31);
  TriangleMesh mesh;
  const auto add = [&](double radius, double angle, double z) {
    const double x = radius * std::cos(angle);
    mesh.positions.push_back({x * std::cos(tilt) - z * std::sin(tilt), radius * std::sin(angle),
                              x * std::sin(tilt) + z * std::cos(tilt)});
  };
  for (uint64_t r = 0; r < rings; ++r) {
    const double up = kPi * static_cast<double>(r + 1) / static_cast<double>(rings + 1);
    const double radius = closed ? std::sin(up) : 1;
    for (VertexIndex i = 0; i < count; ++i) {
      add(radius, 2 * kPi * static_cast<double>(i) / static_cast<double>(count), -3 * std::cos(up));
    }
  }
  const VertexIndex bottom = mesh.positions.size();
  if (closed) {
    add(0, 0, -3);
    add(0, 0, 3);
  }
  const VertexIndex last = bottom - count;
  for (VertexIndex i = 0; i < count; ++i) {
    const VertexIndex j = (i + 1) % count;
    for (VertexIndex r = 0; r < last; r += count) {
      mesh.triangles.push_back({r + i, r + j, r + count + i});
      mesh.triangles.push_back({r + j, r + count + j, r + count + i});
    }
    if (!closed) continue;
    mesh.triangles.push_back({bottom, j, i});
    mesh.triangles.push_back({bottom + 1, last + i, last + j});
  }
  return mesh;
}

TriangleMesh Generated(Status (*generate)(const GenerateOptions&, MeshSink&), int64_t size,
                       uint64_t seed) {
  TriangleMesh mesh;
  TriangleMeshSink sink(&mesh);
  const auto triangles = static_cast<uint64_t>(std::max<int64_t>(100, size));
  (void)generate({.triangles = triangles, .seed = seed}, sink);
  return mesh;
}

TriangleMesh MakeSculpture(int64_t size, uint64_t seed) {
  return Generated(GenerateSculpture, size, seed);
}

TriangleMesh MakeTerrain(int64_t size, uint64_t seed) {
  return Generated(GenerateTerrain, size, seed);
}

// Flat roofs of whole heights over whole columns and rows: most triangles lie in one plane with
// their neighbours.
TriangleMesh MakePlan(int64_t size, uint64_t seed) {
  TriangleMesh mesh = MakeSheetOf(size, seed);
  const auto n = static_cast<int64_t>(std::sqrt(static_cast<double>(mesh.positions.size())));
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    const auto x = static_cast<int64_t>(v) % n, y = static_cast<int64_t>(v) / n;
    const uint64_t block = static_cast<uint64_t>(x / 6 + 1000 * (y / 6)) + seed;
    mesh.positions[v] = {static_cast<double>(x), static_cast<double>(y),
                         static_cast<double>(Mix64(block) % 4)};
  }
  return mesh;
}

// The size says which.
TriangleMesh MakeNasty(int64_t size, uint64_t seed) {
  const auto all = mtdb::testing::NastyMeshes();
  return all[(static_cast<uint64_t>(size) + seed) % all.size()].mesh;
}

struct Shape {
  const char* name;
  TriangleMesh (*make)(int64_t size, uint64_t seed);
};
constexpr Shape kShapes[] = {
    {"sheet", MakeSheetOf},       {"wave", MakeWave},
    {"torus", MakeTorus},         {"tetrahedra", MakeTetrahedra},
    {"tangle", MakeTangle},       {"nasty", MakeNasty},
    {"sculpture", MakeSculpture}, {"terrain", MakeTerrain},
    {"needles", MakeNeedles},     {"plan", MakePlan},
    {"meridians", MakeMeridians},
};

}  // namespace

TriangleMesh MakeShape(const std::string& shape, int64_t size, uint64_t seed) {
  for (const Shape& s : kShapes) {
    if (shape == s.name) return s.make(size, seed);
  }
  return kShapes[0].make(size, seed);
}

std::vector<std::string> ShapeNames() {
  std::vector<std::string> names;
  for (const Shape& s : kShapes) names.emplace_back(s.name);
  return names;
}

}  // namespace mtdb::everything
