// SPDX-License-Identifier: Apache-2.0
// Surfaces of long, thin triangles, and vertices in which very many of them meet.
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "builder/tiles/tiling_choice.h"
#include "tests/builder/fixture.h"

namespace mtdb::testing {

namespace {

// Rings of `meridians` vertices, radii and heights given, joined by long quads; `closed`: and by
// fans to an apex at each end.
TriangleMesh MakeTube(uint32_t meridians, const std::vector<std::array<double, 2>>& rings,
                      bool closed) {
  TriangleMesh mesh;
  for (const auto& [radius, height] : rings) {
    for (uint32_t i = 0; i < meridians; ++i) {
      const double angle = 2 * std::numbers::pi * i / meridians;
      mesh.positions.push_back({radius * std::cos(angle), radius * std::sin(angle), height});
    }
  }
  const VertexIndex bottom = mesh.positions.size();
  if (closed) {
    mesh.positions.push_back({0, 0, rings.front()[1] - 0.5});
    mesh.positions.push_back({0, 0, rings.back()[1] + 0.5});
  }
  const VertexIndex last = bottom - meridians;
  for (VertexIndex i = 0; i < meridians; ++i) {
    const VertexIndex j = (i + 1) % meridians;
    for (VertexIndex r = 0; r < last; r += meridians) {
      mesh.triangles.push_back({r + i, r + j, r + meridians + i});
      mesh.triangles.push_back({r + j, r + meridians + j, r + meridians + i});
    }
    if (!closed) continue;
    mesh.triangles.push_back({bottom, j, i});
    mesh.triangles.push_back({bottom + 1, last + i, last + j});
  }
  return mesh;
}

TriangleMesh MakeComb(uint32_t meridians) {
  return MakeTube(meridians, {{0.6, -0.8}, {0.95, -0.3}, {0.95, 0.3}, {0.6, 0.8}}, true);
}

uint64_t TrianglesWithin(const BuiltObject& built, double error) {
  Query query;
  query.threshold = ConstantThreshold(error * built.record.diagonal());
  return Extract(*built.surface, query).triangles.size();
}

}  // namespace

TEST_CASE("a cylinder of needles is simplified as far as any cylinder") {
  // One tile, several, and more than a window has.
  for (const uint32_t meridians : {4000u, 12'000u, 80'000u}) {
    const BuiltObject built = Build(MakeTube(meridians, {{1, 0}, {1, 5}}, false));
    CAPTURE(meridians);
    CHECK(built.record.root_triangles < 50);
    CHECK(TrianglesWithin(built, 1e-3) < 150);
    CHECK(built.record.boundary_loops == 2);
  }
}

TEST_CASE("a vertex of any valence has a neighbourhood that is simplified") {
  BuildOptions options;
  options.tile_triangles = 1024;
  for (const uint32_t meridians : {2000u, 12'000u}) {
    const BuiltObject built = Build(MakeComb(meridians), options);
    CAPTURE(meridians);
    CHECK(built.record.root_triangles < 100);
    CHECK(TrianglesWithin(built, 1e-2) < 400);
    CHECK(TrianglesWithin(built, 1e-3) < 1200);
    CHECK(built.record.euler_characteristic == 2);
  }
}

TEST_CASE("tilings of long triangles depend on neither threads nor memory") {
  const TriangleMesh mesh = MakeComb(8000);
  TempStore store;
  std::optional<ObjectRecord> first;
  for (const unsigned threads : {1u, 2u}) {
    BuildOptions options;
    options.threads = threads;
    options.tile_triangles = 512;
    if (threads == 1) options.memory_bytes = uint64_t{256} << 20;
    const Result<ObjectRecord> record =
        BuildInto(store.database(), std::to_string(threads), mesh, options);
    REQUIRE(record.ok());
    if (!first) first = *record;
    REQUIRE(record->digest_hex() == first->digest_hex());
    REQUIRE(record->rounds == first->rounds);
  }
}

TEST_CASE("rounds go on while seams are what holds a mesh back, and not for ever") {
  TilingChoice choice(131'072);
  REQUIRE(choice.Next({1'000'000, 250'000, 500'000, 60'000}));
  REQUIRE(choice.owner_levels() == 0);
  REQUIRE(choice.Next({1'000'000, 1'000'000, 500'000, 1'000'000}));
  const uint32_t levels = choice.owner_levels();
  REQUIRE(levels > 0);
  REQUIRE(choice.was_hindered());
  // No progress: finer cells, and at last none.
  REQUIRE(choice.Next({1'000'000, 1'000'000, 500'000, 1'000'000}));
  REQUIRE(choice.owner_levels() > levels);
  int rounds = 0;
  while (choice.Next({1'000'000, 1'000'000, 500'000, 1'000'000})) REQUIRE(++rounds < 10);
  // A window has the mesh: it is cut along it.
  TilingChoice small(131'072);
  REQUIRE(small.Next({200'000, 190'000, 100'000, 200'000}));
  REQUIRE(small.owner_levels() > 0);
  REQUIRE(small.Next({190'000, 120'000, 90'000, 150'000}));
  REQUIRE(small.owner_levels() == 0);
  // Nothing that seams are the reason for.
  TilingChoice stuck(131'072);
  REQUIRE(!stuck.Next({100'000, 99'000, 50'000, 5'000}));
}

}  // namespace mtdb::testing
