// SPDX-License-Identifier: Apache-2.0
// What goes in comes back: at full resolution, a store gives the triangles that were built into it.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>

#include "tests/builder/fixture.h"
#include "tests/builder/nasty_meshes.h"

namespace mtdb::testing {
namespace {

constexpr const char* kSharedMeshes[] = {"bunny.ply",
                                         "nefertiti.ply",
                                         "skull.obj",
                                         "horse_bigendian_colours.ply",
                                         "laurana_colours_normals.ply",
                                         "dragon_res2_ascii_nonmanifold.ply",
                                         "rangescan_ascii_boundary.ply"};

// The full-resolution mesh, compared with `input` on the object's grid.
void RequireRoundTrip(const TriangleMesh& input, const BuiltObject& built) {
  const TriangleMesh full = Extract(*built.surface, Query{});
  REQUIRE(full.header.attributes == input.header.attributes);
  REQUIRE(full.positions.size() == built.record.vertices);
  REQUIRE(full.triangles.size() == built.record.triangles);
  const bool same = Triangles(full) == ExpectedTriangles(input, built.record.grid);
  REQUIRE(same);
  const InputReport& report = built.record.input;
  REQUIRE(report.vertices == input.positions.size());
  REQUIRE(report.triangles == input.triangles.size());
  REQUIRE(built.record.triangles ==
          report.triangles - report.degenerate_triangles - report.duplicate_triangles);
  REQUIRE(built.record.vertices == report.vertices - report.unreferenced_vertices);
}

BuildOptions SmallTiles(uint32_t triangles) {
  BuildOptions options;
  options.tile_triangles = triangles;
  return options;
}

// A value of each type for each vertex, reproducible from its number.
void AddAllAttributes(TriangleMesh* mesh) {
  mesh->header.attributes.attributes = {
      {"a", ScalarType::kInt8},     {"red", ScalarType::kUint8},   {"b", ScalarType::kInt16},
      {"c", ScalarType::kUint16},   {"d", ScalarType::kInt32},     {"id", ScalarType::kUint32},
      {"nx", ScalarType::kFloat32}, {"time", ScalarType::kFloat64}};
  const size_t row = mesh->header.attributes.row_bytes();
  std::mt19937_64 random(3);
  mesh->rows.resize(mesh->positions.size() * row);
  for (std::byte& b : mesh->rows) b = static_cast<std::byte>(random());  // NaN and all
}

}  // namespace

TEST_CASE("A generated surface comes back whole, on the grid and bit by bit") {
  for (const bool closed : {true, false}) {
    TriangleMesh mesh = closed ? MakeSculpture(40000) : MakeTerrain(40000);
    {
      const BuiltObject built = Build(mesh);
      RequireRoundTrip(mesh, built);
      REQUIRE(built.record.rounds.size() > 1);
      REQUIRE(built.record.clusters > 4);
      REQUIRE(built.record.root_triangles < mesh.triangles.size() / 10);
      REQUIRE((built.record.boundary_edges == 0) == closed);
    }
    AddAllAttributes(&mesh);
    BuildOptions lossless = SmallTiles(2048);
    lossless.mode = PositionMode::kLossless;
    const BuiltObject built = Build(mesh, lossless);
    // Positions that the grid does not round: what is expected is the input's own bits.
    for (const Vec3d& p : mesh.positions) {
      const Vec3d q = built.record.grid.Position(built.record.grid.Quantize(p));
      REQUIRE(std::memcmp(&p, &q, sizeof(p)) == 0);
    }
    RequireRoundTrip(mesh, built);
  }
}

TEST_CASE("Positions come back within half a cell of where they were, at any number of bits") {
  TriangleMesh mesh = MakeSculpture(4000);
  NumberVertices(&mesh);
  for (const int bits : {1, 2, 3, 4, 8, 12, 20, 24}) {
    BuildOptions options = SmallTiles(512);
    options.bits = bits;
    const BuiltObject built = Build(mesh, options);
    RequireRoundTrip(mesh, built);
    const TriangleMesh full = Extract(*built.surface, Query{});
    double farthest = 0;
    for (size_t v = 0; v < full.positions.size(); ++v) {
      uint32_t id = 0;
      std::memcpy(&id, full.rows.data() + 4 * v, 4);
      const double distance = Length(full.positions[v] - mesh.positions[id]);
      REQUIRE(distance <= built.record.rounding_error);
      farthest = std::max(farthest, distance);
    }
    REQUIRE(built.record.rounding_error <= built.record.grid.cell_error());
    REQUIRE(built.record.rounding_error <= farthest * (1 + 1e-6));
  }
}

TEST_CASE("A step given in model units keeps its lattice") {
  TriangleMesh mesh = MakeTerrain(2000);
  BuildOptions options;
  options.step = 0.01;
  const BuiltObject built = Build(mesh, options);
  RequireRoundTrip(mesh, built);
  REQUIRE(built.record.grid.step == 0.01);
  for (const Vec3d& p : Extract(*built.surface, Query{}).positions) {
    for (int i = 0; i < 3; ++i) {
      REQUIRE(p[i] / 0.01 == Approx(std::round(p[i] / 0.01)).margin(1e-6));
    }
  }
}

TEST_CASE("Real scans come back whole") {
  for (const char* file : kSharedMeshes) {
    std::optional<TriangleMesh> mesh = LoadSharedMesh(file);
    if (!mesh) continue;
    INFO(file);
    const bool lossless = mesh->triangles.size() < 70000;
    BuildOptions options;
    if (lossless) options.mode = PositionMode::kLossless;
    RequireRoundTrip(*mesh, Build(*mesh, options));
  }
}

TEST_CASE("Nasty meshes come back whole, and what cannot be kept is counted") {
  for (const NastyMesh& nasty : NastyMeshes()) {
    INFO(nasty.name);
    std::vector<BuildOptions> variants(4);
    variants[1].bits = 3;
    variants[1].tile_triangles = 64;
    variants[2].tile_triangles = 64;
    variants[2].reduction = 8;
    variants[3].mode = PositionMode::kLossless;
    TriangleMesh mesh = nasty.mesh;
    for (const BuildOptions& options : variants) {
      const BuiltObject built = Build(mesh, options);
      RequireRoundTrip(mesh, built);
      const InputReport& found = built.record.input;
      REQUIRE(found.unreferenced_vertices == nasty.report.unreferenced_vertices);
      REQUIRE(found.degenerate_triangles == nasty.report.degenerate_triangles);
      REQUIRE(found.duplicate_triangles == nasty.report.duplicate_triangles);
      REQUIRE(found.nonmanifold_edges == nasty.report.nonmanifold_edges);
      REQUIRE(found.nonmanifold_vertices == nasty.report.nonmanifold_vertices);
      REQUIRE(built.record.components == nasty.components);
      REQUIRE(built.record.boundary_edges == nasty.boundary_edges);
    }
    // Without attributes too: nothing tells coinciding vertices apart then.
    mesh.rows.clear();
    mesh.header.attributes.attributes.clear();
    variants[1].keep_apart = true;
    RequireRoundTrip(mesh, Build(mesh, variants[1]));
  }
}

TEST_CASE(
    "A hundred thousand components vanish where they are smaller than the error, and come back") {
  constexpr uint64_t kCount = 100000;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform(0, 100);
  TriangleMesh mesh;
  for (uint64_t i = 0; i < kCount; ++i) {  // octahedra
    const Vec3d c = {uniform(random), uniform(random), uniform(random)};
    const double r = 0.02 + 0.001 * uniform(random);
    const VertexIndex v = mesh.positions.size();
    for (const Vec3d& d : {Vec3d{r, 0, 0}, Vec3d{0, r, 0}, Vec3d{0, 0, r}}) {
      mesh.positions.push_back(c + d);
      mesh.positions.push_back(c - d);
    }
    for (VertexIndex octant = 0; octant < 8; ++octant) {
      TriangleVertices t = {v + (octant & 1), v + 2 + (octant >> 1 & 1), v + 4 + (octant >> 2)};
      if ((octant & 1) ^ (octant >> 1 & 1) ^ (octant >> 2)) std::swap(t[0], t[1]);
      mesh.triangles.push_back(t);
    }
  }
  RoundToFloat32(&mesh);
  const BuiltObject built = Build(mesh);
  REQUIRE(built.record.components == kCount);
  REQUIRE(built.record.input.nonmanifold_vertices == 0);
  // Tetrahedra are left of those that are far from all others.
  REQUIRE(built.record.root_triangles < kCount / 4);
  REQUIRE(Extract(*built.surface, Query{}).triangles.size() == 8 * kCount);
}

TEST_CASE("Vertices that collapse onto few grid cells keep their connectivity") {
  TriangleMesh mesh = MakeSculpture(12000);
  NumberVertices(&mesh);
  uint64_t explicit_clusters = 0;
  for (const int bits : {2, 3, 4}) {
    BuildOptions options = SmallTiles(1024);
    options.bits = bits;
    const BuiltObject built = Build(mesh, options);
    RequireRoundTrip(mesh, built);
    const ClusterIndex& index = built.surface->index();
    for (uint32_t c = 0; c < index.cluster_count(); ++c) {
      explicit_clusters += index.unit(c).explicit_arcs;
    }
  }
  REQUIRE(explicit_clusters > 0);
}

TEST_CASE("Most of a mesh can be simplified, round after round") {
  const BuiltObject built = Build(MakeSculpture(40000), SmallTiles(1024));
  uint64_t nodes = 0;
  uint64_t triangles = built.record.triangles;
  for (const RoundReport& round : built.record.rounds) {
    REQUIRE(round.triangles_in == triangles);
    REQUIRE(round.triangles_out == round.triangles_in - 2 * round.nodes);  // closed: 2 a removal
    triangles = round.triangles_out;
    nodes += round.nodes;
  }
  REQUIRE(built.record.root_triangles == triangles);
  REQUIRE(built.record.nodes == nodes);
  REQUIRE(built.record.nodes + built.record.root_vertices == built.record.vertices);
  REQUIRE(built.record.max_degree <= BuildOptions{}.degree_limit);
  REQUIRE(triangles < 2000);
}

}  // namespace mtdb::testing
