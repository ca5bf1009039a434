// SPDX-License-Identifier: Apache-2.0
// Every cut is a mesh of the same surface: conforming, oriented, manifold where the input is, of
// the same topology.
#include <catch2/catch.hpp>

#include "tests/builder/cgal_mesh.h"
#include "tests/builder/fixture.h"
#include "tests/builder/nasty_meshes.h"
#include "tests/support/mesh_check.h"

namespace mtdb::testing {
namespace {

BuildOptions SmallTiles() {
  BuildOptions options;
  options.tile_triangles = 512;
  return options;
}

// Cuts of a manifold mesh, each asked of CGAL.
void RequireManifoldCuts(const TriangleMesh& mesh, const BuiltObject& built, int cuts,
                         uint32_t seed) {
  const CgalFacts input = AskCgal(mesh);
  REQUIRE(input.manifold);
  REQUIRE(input.border_edges == built.record.boundary_edges);
  REQUIRE(input.border_loops == built.record.boundary_loops);
  REQUIRE(input.components == built.record.components);
  REQUIRE(input.euler_characteristic == built.record.euler_characteristic);
  std::mt19937 random(seed);
  std::set<uint64_t> sizes;
  for (int i = 0; i < cuts; ++i) {
    INFO("cut " << i);
    ExtractStats stats;
    const TriangleMesh cut = Extract(*built.surface, RandomCutQuery(built.record, random), &stats);
    REQUIRE(cut.triangles.size() == stats.triangles);
    REQUIRE(cut.positions.size() == stats.vertices);
    sizes.insert(stats.triangles);
    const CgalFacts facts = AskCgal(cut);
    REQUIRE(facts.manifold);
    REQUIRE(facts.closed == input.closed);
    REQUIRE(facts.euler_characteristic == input.euler_characteristic);
    REQUIRE(facts.border_loops == input.border_loops);
    REQUIRE(facts.components == input.components);
  }
  REQUIRE(sizes.size() > static_cast<size_t>(cuts) / 3);
}

// The mesh without the triangles that a store drops, and without stray vertices.
TriangleMesh Cleaned(const TriangleMesh& mesh) {
  TriangleMesh clean;
  std::set<TriangleVertices> seen;
  std::map<VertexIndex, VertexIndex> number;
  for (TriangleVertices t : mesh.triangles) {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
    while (t[0] > t[1] || t[0] > t[2]) t = {t[1], t[2], t[0]};
    if (!seen.insert(t).second) continue;
    for (VertexIndex& v : t) {
      const auto [at, fresh] = number.try_emplace(v, clean.positions.size());
      if (fresh) clean.positions.push_back(mesh.positions[v]);
      v = at->second;
    }
    clean.triangles.push_back(t);
  }
  return clean;
}

// Cuts of any mesh, by plain counting: nothing is wrong that is not wrong in the input. Small parts
// may have vanished.
void RequireCutsAsTheInput(const TriangleMesh& mesh, const BuiltObject& built, int cuts,
                           uint32_t seed) {
  const MeshCheck input = CheckMesh(Cleaned(mesh));
  REQUIRE(input.components == built.record.components);
  REQUIRE(input.boundary_edges == built.record.boundary_edges);
  REQUIRE(input.euler_characteristic == built.record.euler_characteristic);
  std::mt19937 random(seed);
  for (int i = 0; i < cuts; ++i) {
    INFO("cut " << i);
    Query query = RandomCutQuery(built.record, random);
    if (i == 0) {
      query = Query{};
      query.threshold = CoarsestThreshold();
    }
    const MeshCheck cut = CheckMesh(Extract(*built.surface, query));
    REQUIRE(cut.bad_indices == 0);
    REQUIRE(cut.unused_vertices == 0);
    REQUIRE(cut.degenerate_triangles == 0);
    // Chains of creases and two-sided sheets become coarser; what meets there, tests/sheets knows.
    for (const auto& faults : {&MeshCheck::duplicate_triangles, &MeshCheck::nonmanifold_edges,
                               &MeshCheck::misoriented_edges, &MeshCheck::nonmanifold_vertices}) {
      REQUIRE(cut.*faults <= input.*faults);
    }
    REQUIRE(cut.components <= input.components);
    if (cut.components < input.components || !input.ok()) continue;
    REQUIRE(cut.euler_characteristic == input.euler_characteristic);
    REQUIRE(cut.boundary_loops == input.boundary_loops);
  }
}

}  // namespace

TEST_CASE("Random cuts of a closed surface are closed surfaces of the same genus") {
  const TriangleMesh mesh = MakeSculpture(12000);
  RequireManifoldCuts(mesh, Build(mesh, SmallTiles()), 120, 1);
}

TEST_CASE("Random cuts of an open surface keep its border loops") {
  const TriangleMesh mesh = MakeTerrain(10000);
  RequireManifoldCuts(mesh, Build(mesh, SmallTiles()), 120, 2);
  // A sheet with holes: every third inner cell row has some cells taken out.
  TriangleMesh holes = MakeSheet(60, 0.02);
  std::vector<TriangleVertices> kept;
  for (size_t t = 0; t < holes.triangles.size(); ++t) {
    const size_t i = t / 2 % 60;
    const size_t j = t / 120;
    if (i % 6 < 2 && j % 6 < 2 && i > 5 && j > 5) continue;
    kept.push_back(holes.triangles[t]);
  }
  holes.triangles = kept;
  const TriangleMesh clean = Cleaned(holes);
  const BuiltObject built = Build(clean, SmallTiles());
  REQUIRE(built.record.boundary_loops == 82);
  RequireManifoldCuts(clean, built, 80, 3);
}

TEST_CASE("Random cuts of coarsely quantised surfaces keep their topology") {
  const TriangleMesh mesh = MakeSculpture(6000);
  for (const int bits : {2, 5}) {
    BuildOptions options = SmallTiles();
    options.bits = bits;
    RequireManifoldCuts(mesh, Build(mesh, options), 25, 4);
  }
}

TEST_CASE("Random cuts of a scan keep its topology") {
  if (const std::optional<TriangleMesh> mesh = LoadSharedMesh("bunny.ply")) {
    RequireManifoldCuts(*mesh, Build(*mesh), 25, 5);
  }
  if (const std::optional<TriangleMesh> mesh =
          LoadSharedMesh("dragon_res2_ascii_nonmanifold.ply")) {
    RequireCutsAsTheInput(*mesh, Build(*mesh), 4, 6);
  }
}

TEST_CASE("Random cuts of nasty meshes are as good as their input, and no better") {
  uint32_t seed = 10;
  for (const NastyMesh& nasty : NastyMeshes()) {
    INFO(nasty.name);
    BuildOptions small = SmallTiles();
    small.tile_triangles = 64;
    RequireCutsAsTheInput(nasty.mesh, Build(nasty.mesh, small), 8, ++seed);
    small.bits = 3;
    RequireCutsAsTheInput(nasty.mesh, Build(nasty.mesh, small), 4, ++seed);
  }
}

TEST_CASE("Random triangle soups give cuts as good as their input") {
  std::mt19937 random(77);
  for (int round = 0; round < 30; ++round) {
    INFO("soup " << round);
    // A sheet with random triangles taken out, turned over, doubled and added.
    TriangleMesh mesh = MakeSheet(14, 0.05, static_cast<uint32_t>(round));
    const auto pick = [&](size_t n) { return random() % n; };
    for (int k = 0; k < 4; ++k) {
      const size_t t = pick(mesh.triangles.size());
      switch (random() % 4) {
        case 0:
          mesh.triangles.erase(mesh.triangles.begin() + static_cast<std::ptrdiff_t>(t));
          break;
        case 1: std::swap(mesh.triangles[t][0], mesh.triangles[t][1]); break;
        case 2: mesh.triangles.push_back(mesh.triangles[t]); break;
        default:
          mesh.triangles.push_back({pick(mesh.positions.size()), pick(mesh.positions.size()),
                                    pick(mesh.positions.size())});
      }
    }
    NumberVertices(&mesh);
    BuildOptions options;
    options.tile_triangles = 64;
    RequireCutsAsTheInput(mesh, Build(mesh, options), 4, static_cast<uint32_t>(round));
  }
}

}  // namespace mtdb::testing
