// SPDX-License-Identifier: Apache-2.0
#include "tests/builder/nasty_meshes.h"

#include <cmath>
#include <random>

#include "tests/support/mesh_changes.h"

namespace mtdb::testing {

namespace {

constexpr double kPi = 3.14159265358979;

VertexIndex AddVertex(TriangleMesh* mesh, Vec3d p) {
  mesh->positions.push_back(p);
  return mesh->positions.size() - 1;
}

// Adds a grid of m x n cells over `vertex(i, j)`, 0 <= i <= m, 0 <= j <= n.
template <typename Vertex>
void AddGrid(TriangleMesh* mesh, int m, int n, const Vertex& vertex) {
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < m; ++i) {
      const VertexIndex a = vertex(i, j), b = vertex(i + 1, j);
      const VertexIndex c = vertex(i + 1, j + 1), d = vertex(i, j + 1);
      mesh->triangles.push_back({a, b, c});
      mesh->triangles.push_back({a, c, d});
    }
  }
}

// A closed torus of m x n cells.
TriangleMesh MakeTorus(int m, int n) {
  TriangleMesh mesh;
  for (int j = 0; j < n; ++j) {
    for (int i = 0; i < m; ++i) {
      const double u = 2 * kPi * i / m, v = 2 * kPi * j / n;
      const double r = 1 + 0.4 * std::cos(v);
      AddVertex(&mesh, {r * std::cos(u), r * std::sin(u), 0.4 * std::sin(v)});
    }
  }
  AddGrid(&mesh, m, n, [&](int i, int j) { return static_cast<VertexIndex>((j % n) * m + i % m); });
  return mesh;
}

void AddTetrahedron(TriangleMesh* mesh, Vec3d at, double size) {
  const VertexIndex a = AddVertex(mesh, at);
  const VertexIndex b = AddVertex(mesh, at + Vec3d{size, 0, 0});
  const VertexIndex c = AddVertex(mesh, at + Vec3d{0, size, 0});
  const VertexIndex d = AddVertex(mesh, at + Vec3d{0, 0, size});
  for (const TriangleVertices& t : {TriangleVertices{a, c, b}, TriangleVertices{a, b, d},
                                    TriangleVertices{a, d, c}, TriangleVertices{b, c, d}}) {
    mesh->triangles.push_back(t);
  }
}

// Three half-sheets that meet along an edge of n segments.
TriangleMesh MakeThreeSheets(int n) {
  TriangleMesh mesh;
  std::vector<VertexIndex> spine;
  for (int j = 0; j <= n; ++j) spine.push_back(AddVertex(&mesh, {0, 0.1 * j, 0}));
  for (int sheet = 0; sheet < 3; ++sheet) {
    const double angle = 2 * kPi * sheet / 3;
    std::vector<VertexIndex> rows;
    for (int j = 0; j <= n; ++j) {
      for (int i = 1; i <= n; ++i) {
        const double r = 0.1 * i;
        rows.push_back(AddVertex(
            &mesh, {r * std::cos(angle), 0.1 * j + 0.01 * std::sin(3.0 * i), r * std::sin(angle)}));
      }
    }
    AddGrid(&mesh, n, n, [&](int i, int j) {
      const auto ju = static_cast<size_t>(j);
      return i == 0 ? spine[ju] : rows[ju * static_cast<size_t>(n) + static_cast<size_t>(i) - 1];
    });
  }
  return mesh;
}

// A band of m cells around and n across, closed with half a turn.
TriangleMesh MakeMoebius(int m, int n) {
  TriangleMesh mesh;
  for (int i = 0; i < m; ++i) {
    const double u = 2 * kPi * i / m;
    for (int j = 0; j <= n; ++j) {
      const double w = 0.8 * (static_cast<double>(j) / n - 0.5);
      const double r = 1 + w * std::cos(u / 2);
      AddVertex(&mesh, {r * std::cos(u), r * std::sin(u), w * std::sin(u / 2)});
    }
  }
  AddGrid(&mesh, m, n,
          [&](int i, int j) { return static_cast<VertexIndex>(i == m ? n - j : i * (n + 1) + j); });
  return mesh;
}

}  // namespace

TriangleMesh MakeSheet(int n, double roughness, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> height(-roughness, roughness);
  TriangleMesh mesh;
  for (int j = 0; j <= n; ++j) {
    for (int i = 0; i <= n; ++i) {
      AddVertex(&mesh, {static_cast<double>(i) / n, static_cast<double>(j) / n, height(random)});
    }
  }
  AddGrid(&mesh, n, n, [&](int i, int j) { return static_cast<VertexIndex>(j * (n + 1) + i); });
  RoundToFloat32(&mesh);
  return mesh;
}

std::vector<NastyMesh> NastyMeshes() {
  std::vector<NastyMesh> list;
  const auto add = [&](const std::string& name, TriangleMesh mesh, uint64_t components,
                       uint64_t boundary_edges) -> InputReport& {
    NumberVertices(&mesh);
    RoundToFloat32(&mesh);
    InputReport report;
    report.vertices = mesh.positions.size();
    report.triangles = mesh.triangles.size();
    list.push_back({name, std::move(mesh), report, components, boundary_edges});
    return list.back().report;
  };

  {
    TriangleMesh mesh;
    mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    mesh.triangles = {{0, 1, 2}};
    add("one triangle", mesh, 1, 3);
  }
  {
    TriangleMesh mesh;
    AddTetrahedron(&mesh, {0, 0, 0}, 1);
    add("tetrahedron", mesh, 1, 0);
  }
  {
    TriangleMesh mesh;
    mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
    mesh.triangles = {{0, 1, 2}, {0, 3, 4}};
    add("bow tie of two triangles", mesh, 1, 6).nonmanifold_vertices = 1;
  }
  {
    // Two sheets, one above the other, that have their middle vertex in common.
    TriangleMesh mesh = MakeSheet(16);
    const auto count = static_cast<VertexIndex>(mesh.positions.size());
    const size_t triangles = mesh.triangles.size();
    const VertexIndex middle = 8 * 17 + 8;
    mesh.positions[middle].z = 0.5;
    for (VertexIndex v = 0; v < count; ++v) AddVertex(&mesh, mesh.positions[v] + Vec3d{0, 0, 1});
    for (size_t t = 0; t < triangles; ++t) {
      TriangleVertices upper = mesh.triangles[t];
      for (VertexIndex& v : upper) v = v == middle ? v : v + count;
      mesh.triangles.push_back(upper);
    }
    InputReport& report = add("two sheets touch in a vertex", mesh, 1, 128);
    report.nonmanifold_vertices = 1;
    report.unreferenced_vertices = 1;
  }
  {
    InputReport& report = add("three sheets meet in an edge", MakeThreeSheets(12), 1, 3 * 36);
    report.nonmanifold_edges = 12;
    report.nonmanifold_vertices = 2;  // the ends of the chain; likewise below
  }
  {
    TriangleMesh mesh = MakeSheet(16);
    for (size_t t = mesh.triangles.size() / 2; t < mesh.triangles.size(); ++t) {
      std::swap(mesh.triangles[t][1], mesh.triangles[t][2]);
    }
    InputReport& report = add("two halves of opposite orientation", mesh, 1, 64);
    report.nonmanifold_edges = 16;
    report.nonmanifold_vertices = 2;
  }
  {
    InputReport& report = add("Moebius strip", MakeMoebius(60, 8), 1, 120);
    report.nonmanifold_edges = 8;
    report.nonmanifold_vertices = 2;
  }
  {
    TriangleMesh mesh = MakeTorus(24, 12);
    const TriangleVertices t = mesh.triangles[5];
    mesh.triangles.push_back({t[1], t[2], t[0]});
    mesh.triangles.insert(mesh.triangles.begin(), t);
    mesh.triangles.push_back(mesh.triangles[100]);
    mesh.triangles.push_back({3, 3, 7});
    mesh.triangles.push_back({9, 9, 9});
    mesh.triangles.push_back({4, 8, 4});
    AddVertex(&mesh, {50, 50, 50});
    InputReport& report = add("duplicate and degenerate faces, a stray vertex", mesh, 1, 0);
    report.duplicate_triangles = 3;
    report.degenerate_triangles = 3;
    report.unreferenced_vertices = 1;
  }
  {
    // A face and its mirror image share three edges with the sheet around them.
    TriangleMesh mesh = MakeSheet(12);
    const TriangleVertices t = mesh.triangles[150];
    mesh.triangles.push_back({t[0], t[2], t[1]});
    InputReport& report = add("a face doubled in opposite orientation", mesh, 1, 48);
    report.nonmanifold_edges = 3;
  }
  {
    TriangleMesh mesh;
    mesh.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    mesh.triangles = {{0, 1, 2}, {0, 2, 1}};
    add("a pillow of two faces", mesh, 1, 0);
  }
  {
    TriangleMesh mesh;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> at(0, 100);
    for (int i = 0; i < 2000; ++i) {
      AddTetrahedron(&mesh, {at(random), at(random), at(random)}, 0.3);
    }
    add("2,000 tetrahedra", mesh, 2000, 0);
  }
  add("a flat sheet", MakeSheet(40, 0), 1, 160);
  {
    TriangleMesh mesh = MakeSheet(24, 0);
    for (Vec3d& p : mesh.positions) p.y = p.z = 0;
    add("all vertices on a line", mesh, 1, 96);
  }
  {
    TriangleMesh mesh = MakeSheet(24, 0);
    for (Vec3d& p : mesh.positions) p = {1, 2, 3};
    add("all vertices in one place", mesh, 1, 96);
  }
  {
    TriangleMesh mesh = MakeTorus(40, 20);
    mesh.positions[205] = mesh.positions[206];
    mesh.positions[410] = mesh.positions[17];
    add("vertices that coincide exactly", mesh, 1, 0);
  }
  {
    // The same sheet twice, in the same place, on vertices of its own.
    TriangleMesh mesh = MakeSheet(16);
    const auto count = static_cast<VertexIndex>(mesh.positions.size());
    const size_t triangles = mesh.triangles.size();
    for (VertexIndex v = 0; v < count; ++v) AddVertex(&mesh, mesh.positions[v]);
    for (size_t t = 0; t < triangles; ++t) {
      TriangleVertices copy = mesh.triangles[t];
      for (VertexIndex& v : copy) v += count;
      mesh.triangles.push_back(copy);
    }
    add("two sheets in the same place", mesh, 2, 128);
  }
  {
    // A fan of 3,000 triangles round one vertex: far beyond any degree limit.
    TriangleMesh mesh;
    AddVertex(&mesh, {0, 0, 1});
    for (int i = 0; i < 3000; ++i) {
      AddVertex(&mesh, {std::cos(2 * kPi * i / 3000), std::sin(2 * kPi * i / 3000), 0});
    }
    for (VertexIndex i = 0; i < 3000; ++i) {
      mesh.triangles.push_back({0, 1 + i, 1 + (i + 1) % 3000});
    }
    add("a cone of 3,000 triangles", mesh, 1, 3000);
  }
  return list;
}

}  // namespace mtdb::testing
